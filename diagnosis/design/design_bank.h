#pragma once

#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A residual that was asked for, and what became of it.
struct ResidualReport {
  std::string name;
  std::vector<std::size_t> ignores;
  bool exists = false;
  Eigen::Index dim_w = 0;         ///< dim W*
  Eigen::Index dim_s = 0;         ///< dim S*
  Eigen::MatrixXd projector_w;    ///< n×n
  Eigen::MatrixXd projector_s;    ///< n×n
  Eigen::Index quotient_dim = 0;  ///< n - dim S*
  Eigen::Index rows = 0;          ///< rows of the residual
  std::vector<double> margin;  ///< per fault: ‖b_j - Π_S b_j‖ / ‖b_j‖; empty if it has no row
  std::vector<double> dc_gain;  ///< per fault, per fault size, before discretisation
  std::string reason;           ///< why it does not exist; empty if it does
};

/// The answer of a design. "Not solvable" is an answer, not an error.
struct DesignResult {
  bool is_solvable = false;  ///< every residual asked for exists and sees every fault it must
  Bank bank;                 ///< of the residuals that exist
  std::vector<ResidualReport> residuals;
  /// Sets {ignored | fault}: the residual that ignores them cannot see this fault.
  struct Failure {
    std::vector<std::size_t> ignores;
    std::size_t fault = 0;
  };
  std::vector<Failure> failing;
  bool are_signatures_distinct =
      false;  ///< generic signatures of all sets of up to p faults differ
};

/// Designs the bank that `request` asks for, for `plant`.
/// @throws InputError what is asked cannot be asked of this plant (poles outside the stable region,
///   unpaired complex poles, unknown disturbance, no faults, p < 1, method unknown).
[[nodiscard]] DesignResult design_bank(const PlantModel& plant, const BankRequest& request);

}  // namespace faultline

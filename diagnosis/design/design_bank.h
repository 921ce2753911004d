#pragma once

#include <complex>
#include <functional>
#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/design_model.h"
#include "diagnosis/design/eigenstructure/eigenstructure_report.h"
#include "diagnosis/design/geometric.h"
#include "diagnosis/design/uio/observer_report.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A residual that was asked for, and what became of it.
struct ResidualReport {
  std::string name;
  FaultSet ignores;
  bool exists = false;
  Eigen::Index dim_w = 0;         ///< dim W*
  Eigen::Index dim_s = 0;         ///< dim S*
  Eigen::MatrixXd projector_w;    ///< n×n; states, then constant disturbances
  Eigen::MatrixXd projector_s;    ///< n×n
  Eigen::Index quotient_dim = 0;  ///< n - dim S*
  Eigen::Index rows = 0;          ///< rows of the residual
  RankMargin rank_margin;         ///< of all rank decisions behind it
  DimensionStability stability;   ///< tolerances that give the same dimensions
  /// Per fault, what decided whether it is seen: GeometricQuotient::visible_margin; empty if it has
  /// no row.
  std::vector<double> margin;
  std::vector<Sensitivity> sees;            ///< per fault; empty if it does not exist
  std::vector<double> dc_gain;              ///< per fault, per fault size, before discretisation
  std::vector<std::complex<double>> poles;  ///< of F, before discretisation
  std::string reason;                       ///< why it does not exist; empty if it does
};

/// A residual that cannot see a fault which it should.
struct DesignFailure {
  FaultSet ignores;
  std::size_t fault = 0;
  std::string reason;
};

/// The answer of a design. "Not solvable" is an answer, not an error.
struct DesignResult {
  /// Every residual asked for exists and sees every fault it must; with the smallest structure: all
  /// signatures are distinct.
  bool is_solvable = false;
  Bank bank;  ///< of the residuals that exist; certificates are not filled in (diagnosis/certify)
  std::vector<ResidualReport> residuals;
  std::vector<DesignFailure> failing;
  /// Method "eigenstructure": per residual asked for, how the unknown inputs are kept out or small.
  std::vector<EigenstructureReport> assignments;
  std::vector<ObserverReport> observers;  ///< method "uio": what was tried, and what was taken
  bool are_signatures_distinct =
      false;  ///< generic signatures of all sets of up to p faults differ
  /// Sets of up to p faults that have one signature, in groups of two and more.
  std::vector<std::vector<FaultSet>> indistinguishable;
  std::size_t candidate_count = 0;           ///< smallest structure: residuals to choose from
  bool is_structure_proved_smallest = true;  ///< false: the search was cut short
};

/// Told after each residual how many of how many are done.
using DesignProgress = std::function<void(std::size_t done, std::size_t total)>;

/// Designs the bank that `request` asks for, for `plant`.
/// @throws InputError what is asked cannot be asked of this plant (poles outside the stable region,
///   unpaired complex poles, more often than possible; unknown disturbance or fault; no state, no
///   output, no fault; numbers that are not finite; p < 1; method unknown).
[[nodiscard]] DesignResult design_bank(const PlantModel& plant, const BankRequest& request,
                                       const DesignProgress& progress = {});

}  // namespace faultline

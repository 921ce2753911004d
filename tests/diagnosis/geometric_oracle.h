#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// What the oracle says of one residual; fault indices from 0.
struct OracleResidual {
  std::vector<std::size_t> ignores;
  Eigen::Index dim_w = 0, dim_s = 0, quotient_dim = 0, rows = 0;
  Eigen::MatrixXd projector_w, projector_s;
  std::vector<double> margin;               ///< per fault
  std::vector<std::size_t> responds;        ///< faults it sees
  std::vector<std::size_t> transient_only;  ///< of these, the ones with zero DC gain
};

/// A case of tests/golden/geometric: a problem and its answer.
struct OracleCase {
  std::string name;
  Eigen::MatrixXd A, B, C;
  Eigen::MatrixXd Df;  ///< q×0: none
  std::size_t concurrent = 1;
  std::vector<double> poles;
  bool is_solvable = false;
  bool are_signatures_distinct = false;
  bool is_strongly_isolable = false;
  std::vector<std::vector<std::size_t>> confusable_2p_sets;  ///< sets of 2p dependent faults
  std::vector<std::pair<std::vector<std::size_t>, std::size_t>> failing;  ///< ignores | fault
  std::vector<OracleResidual> residuals;

  [[nodiscard]] PlantModel plant() const;  ///< actuator faults on all inputs, Df as disturbances
  [[nodiscard]] BankRequest request() const;
};

/// Hou's example, then all of geometric_cases.json.
[[nodiscard]] std::vector<OracleCase> oracle_cases();

/// Hou's generators in closed form; rows of one-row matrices.
struct ExactGenerator {
  Eigen::MatrixXd P, F, E, G, M, H;
};
[[nodiscard]] std::map<std::string, ExactGenerator> exact_hou_generators();

/// What output projection makes of Hou's example with the measurement disturbance `e1`, `e2`, `e3`.
struct OracleProjection {
  std::vector<std::size_t> ignores;
  Eigen::Index dim_s = 0;
  Eigen::MatrixXd projector_s;
  std::vector<std::size_t> responds;
};
[[nodiscard]] std::vector<OracleProjection> oracle_projections(const std::string& disturbance);

/// What becomes of it when the disturbance is taken as constant.
struct OracleConstantBias {
  std::vector<std::size_t> ignores;
  Eigen::Index dim_s = 0;
  std::vector<std::size_t> responds;
  std::vector<bool> has_dc;  ///< per fault: DC gain that is not zero
};
[[nodiscard]] std::vector<OracleConstantBias> oracle_constant_bias(const std::string& disturbance);

/// One scenario of hou_simulation.json.
struct OracleScenario {
  struct Step {
    std::size_t fault = 0;
    double at_s = 0.0;
    double value = 0.0;  ///< added to the fault
  };
  struct Residual {
    std::optional<double> first_crossing_s;
    double final_value = 0.0;
  };
  std::string name;
  std::vector<Step> steps;
  std::map<std::string, Residual> residuals;
};
/// The scenarios of additive faults without noise.
[[nodiscard]] std::vector<OracleScenario> oracle_scenarios();

}  // namespace faultline

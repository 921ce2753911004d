#pragma once

#include <string>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// The flexible-joint robot of Gao, Liu, Chen with the bounds of its oracle: faults "u" (actuator)
/// and "y1" (sensor), disturbances zd1..zd3, one noise, φ = sin.
[[nodiscard]] PlantModel joint_plant();

/// An observer of the oracle (tests/golden/uio/l1_cases.json).
struct ObserverCase {
  std::string name;
  nlohmann::json numbers;

  [[nodiscard]] static ObserverCase detection();  ///< decouples everything
  [[nodiscard]] static ObserverCase combined();   ///< T = 0, y1 carried as a state
  [[nodiscard]] static ObserverCase estimator();  ///< decouples everything, y1 carried

  /// A number, vector or matrix of it: "gain", "checks/l1_rbar".
  [[nodiscard]] Eigen::MatrixXd matrix(const std::string& path) const;

  /// A bank with the filter of y - ŷ, evaluated row by row, and, where y1 is carried, the one of
  /// its estimate. P, μ where the oracle has them, in the first. Nothing certified.
  [[nodiscard]] Bank bank() const;
};

/// A plant of two states with one Lipschitz term of slopes 0 to 1 (middle 0.5), a feedthrough, a
/// disturbance and a noise on each output; an observer with T = 0 and the fault of sensor y1
/// carried. Sampled exactly.
[[nodiscard]] PlantModel tanh_plant();
[[nodiscard]] Bank tanh_bank();

}  // namespace faultline

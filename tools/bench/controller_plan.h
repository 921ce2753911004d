#pragma once

#include <complex>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "sim/control_design.h"
#include "tools/bench/bench_parts.h"

namespace faultline {

/// The controller of a scenario, worked out: shapes checked against the plant, gains computed.
struct ControllerPlan {
  /// A fresh controller each time; one that is nullptr for kind external.
  ControllerMaker make;
  Eigen::MatrixXd K, L;                    ///< empty where the kind has none
  std::optional<LinearController> linear;  ///< of a kind with feedback: within its limits
  /// Of a kind with feedback: per sample, the largest first. About the operating point.
  std::vector<std::complex<double>> observer_poles, closed_loop_poles;
  std::vector<std::string> warnings;
};

/// The CSV file of a controller of kind recorded; of other kinds nothing.
/// @throws InputError it is not there; std::system_error it cannot be read.
[[nodiscard]] std::optional<RunPart> read_commands(const Scenario& scenario);

/// @param plant the scenario's
/// @param commands the record of kind recorded
/// @throws InputError wrong shapes, unknown channels, a reference that the plant cannot hold, a
/// plant that the kind cannot control; with the place in the scenario.
[[nodiscard]] ControllerPlan plan_controller(const Scenario& scenario, const PlantModel& plant,
                                             double sample_time_s,
                                             const std::optional<NamedText>& commands);

}  // namespace faultline

#include <numbers>
#include <stdexcept>

#include <fmt/format.h>

#include "sim/static_feedback.h"
#include "tools/bench/bench_parts.h"

namespace faultline {
namespace {

void check_controller_shape(const Scenario& scenario, const char* key,
                            const Eigen::MatrixXd& matrix, Eigen::Index rows, Eigen::Index cols) {
  if (matrix.rows() == rows && matrix.cols() == cols) return;
  throw scenario_error(scenario, "controller", key,
                       fmt::format("controller.{}: found {}×{}, expected {}×{}", key, matrix.rows(),
                                   matrix.cols(), rows, cols));
}

ControlLaw make_feedback(const Scenario& scenario, const PlantModel& plant, double sample_time_s) {
  const ControllerSpec& spec = scenario.controller;
  const Eigen::VectorXd feedforward = spec.feedforward.value_or(Eigen::VectorXd::Zero(plant.m()));
  check_controller_shape(scenario, "feedforward", feedforward, plant.m(), 1);
  try {
    switch (spec.kind) {
      case ControllerKind::kNone:
        return open_loop(plant, feedforward);
      case ControllerKind::kGain:
        check_controller_shape(scenario, "K", *spec.K, plant.m(), plant.n());
        return state_feedback(plant, *spec.K, feedforward);
      case ControllerKind::kLqr: {
        const Eigen::MatrixXd Q = spec.Q.value_or(Eigen::MatrixXd::Identity(plant.n(), plant.n()));
        const Eigen::MatrixXd R = spec.R.value_or(Eigen::MatrixXd::Identity(plant.m(), plant.m()));
        check_controller_shape(scenario, "Q", Q, plant.n(), plant.n());
        check_controller_shape(scenario, "R", R, plant.m(), plant.m());
        return state_feedback(plant, lqr_gain(plant, sample_time_s, Q, R), feedforward);
      }
    }
  } catch (const std::invalid_argument& error) {
    throw scenario_error(scenario, "controller", "", fmt::format("controller: {}", error.what()));
  }
  return {};
}

ControlLaw make_control_law(const Scenario& scenario, const PlantModel& plant,
                            double sample_time_s) {
  ControlLaw law = make_feedback(scenario, plant, sample_time_s);
  if (const auto& amplitude = scenario.controller.amplitude) {
    check_controller_shape(scenario, "amplitude", *amplitude, plant.m(), 1);
    law.amplitude = *amplitude;
    law.omega_rad = 2.0 * std::numbers::pi * sample_time_s * *scenario.controller.frequency_Hz;
  }
  return law;
}

}  // namespace

ControllerMaker controller_maker(const Scenario& scenario, const PlantModel& plant,
                                 double sample_time_s) {
  const ControlLaw law = make_control_law(scenario, plant, sample_time_s);
  return [law] { return std::make_unique<StaticFeedback>(law); };
}

}  // namespace faultline

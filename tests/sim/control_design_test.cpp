#include "sim/control_design.h"

#include <cmath>
#include <stdexcept>

#include <Eigen/LU>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/riccati.h"
#include "sim/plant_dynamics.h"
#include "tests/sim/test_plants.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using testing::HasSubstr;

constexpr double kSampleTime_s = 0.1;

/// Of the double integrator, the position alone measured.
PlantModel position_only() {
  PlantModel model = double_integrator();
  model.C = (MatrixXd(1, 2) << 1, 0).finished();
  model.D = MatrixXd::Zero(1, 1);
  model.output_names = {"y1"};
  model.y_operating = Eigen::VectorXd::Constant(1, 1.0);
  return model;
}

template <class Action>
std::string error_of(const Action& action) {
  try {
    action();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(SamplePlant, TakesNonlinearitiesByTheirSlope) {
  // x' = x + u - 3 sin x: A = -2.
  const PlantModel model = scalar_plant(1.0, -3.0, {.kind = FunctionKind::kSin});
  const DiscretePlant sampled = sample_plant(model, kSampleTime_s);
  EXPECT_NEAR(sampled.A(0, 0), std::exp(-2.0 * kSampleTime_s), 1e-9);
  EXPECT_NEAR(sampled.B(0, 0), (1.0 - std::exp(-2.0 * kSampleTime_s)) / 2.0, 1e-9);
  EXPECT_EQ(sampled.D(0, 0), 0.25);
}

TEST(SamplePlant, LeavesAPlantInDiscreteTimeAsItIs) {
  PlantModel model = double_integrator();
  model.time = TimeDomain::kDiscrete;
  EXPECT_EQ(sample_plant(model, kSampleTime_s).A, model.A);
  EXPECT_EQ(sample_plant(model, kSampleTime_s).B, model.B);
}

TEST(ClosedLoopPoles, CountTheCycleBetweenMeasurementAndAction) {
  // x_k+1 = a x_k + b u_k, u_k+1 = -K x_k: λ² - a λ + b K = 0.
  const double a = 0.9, b = 0.5, K = 0.3;
  const DiscretePlant plant{MatrixXd::Constant(1, 1, a), MatrixXd::Constant(1, 1, b),
                            MatrixXd::Ones(1, 1), MatrixXd::Zero(1, 1)};
  const auto poles = closed_loop_poles(plant, static_controller(MatrixXd::Constant(1, 1, -K)));
  ASSERT_EQ(poles.size(), 2U);
  const double root = std::sqrt(a * a / 4.0 - b * K);
  EXPECT_NEAR(poles[0].real(), a / 2.0 + root, 1e-12);
  EXPECT_NEAR(poles[1].real(), a / 2.0 - root, 1e-12);
}

TEST(CheckDetectable, NamesTheModeThatNoOutputShows) {
  PlantModel model = double_integrator();
  model.C = (MatrixXd(1, 2) << 0, 1).finished();
  model.D = MatrixXd::Zero(1, 1);
  const DiscretePlant sampled = sample_plant(model, kSampleTime_s);
  const std::string error = error_of([&] { check_detectable(sampled, model.state_names); });
  EXPECT_THAT(error, HasSubstr("mode at 1 per sample"));
  EXPECT_THAT(error, HasSubstr("\"position\""));
  EXPECT_THAT(error, HasSubstr("no output shows"));
}

TEST(CheckDetectable, AcceptsAHiddenModeThatDecays) {
  PlantModel model = double_integrator();
  model.A = (MatrixXd(2, 2) << -1, 0, 0, 0).finished();
  model.C = (MatrixXd(1, 2) << 0, 1).finished();
  model.D = MatrixXd::Zero(1, 1);
  EXPECT_NO_THROW(check_detectable(sample_plant(model, kSampleTime_s), model.state_names));
}

TEST(CheckStabilisable, NamesTheModeThatNoInputMoves) {
  PlantModel model = double_integrator();
  model.A = (MatrixXd(2, 2) << 0.5, 0, 0, -1).finished();
  const DiscretePlant sampled = sample_plant(model, kSampleTime_s);
  const std::string error = error_of([&] { check_stabilisable(sampled, model.state_names); });
  EXPECT_THAT(error, HasSubstr("\"position\""));
  EXPECT_THAT(error, HasSubstr("no input moves"));
}

TEST(KalmanGain, SolvesItsRiccatiEquation) {
  const PlantModel model = position_only();
  const DiscretePlant plant = sample_plant(model, kSampleTime_s);
  const NoiseCovariances noise{(MatrixXd(2, 2) << 0.2, 0.05, 0.05, 0.4).finished(),
                               MatrixXd::Constant(1, 1, 0.3)};
  const MatrixXd L = kalman_gain(plant, noise, model.state_names);
  // The error's covariance under this L, by its Lyapunov recursion: it must be the optimal one.
  MatrixXd P = MatrixXd::Identity(2, 2);
  const MatrixXd A_L = plant.A - L * plant.C;
  for (int i = 0; i < 2000; ++i) {
    P = (A_L * P * A_L.transpose() + noise.Q_w + L * noise.R_v * L.transpose()).eval();
  }
  const MatrixXd innovation = plant.C * P * plant.C.transpose() + noise.R_v;
  EXPECT_LT((L - plant.A * P * plant.C.transpose() * innovation.inverse()).norm(), 1e-10);
}

TEST(KalmanGain, RefusesAPlantThatCannotBeSeen) {
  PlantModel model = double_integrator();
  model.C = MatrixXd::Zero(1, 2);
  model.D = MatrixXd::Zero(1, 1);
  const DiscretePlant plant = sample_plant(model, kSampleTime_s);
  EXPECT_THROW(static_cast<void>(kalman_gain(
                   plant, {MatrixXd::Identity(2, 2), MatrixXd::Identity(1, 1)}, model.state_names)),
               std::invalid_argument);
}

TEST(NoiseCovariances, TakeBoundsAsEvenlySpread) {
  PlantModel model = scalar_plant(0.0, 0.0, {.kind = FunctionKind::kSin});
  model.input_range = Eigen::VectorXd::Constant(1, 2.0);
  const NoiseCovariances covariances = noise_covariances(model, kSampleTime_s);
  // wind: 0.5 on the state, 2 on the output, |.| <= 0.1; x' = w: one sample adds T w.
  const double wind = 0.01 / 3.0;
  const double doubt = 0.02 * 0.02;  // 1 % of the input's range
  EXPECT_NEAR(covariances.Q_w(0, 0), kSampleTime_s * kSampleTime_s * (wind * 0.25 + doubt), 1e-15);
  // hum: 3, |.| <= 0.2; hiss: 4, sigma 0.1; 0.1 % of the output's range of 1.
  EXPECT_NEAR(covariances.R_v(0, 0), wind * 4.0 + 0.04 / 3.0 * 9.0 + 0.01 * 16.0 + 1e-6, 1e-15);
}

TEST(SteadyState, IsAtRestWithTheOutputThere) {
  const DiscretePlant plant = sample_plant(position_only(), kSampleTime_s);
  const SteadyState target = steady_state(plant, {0});
  const Eigen::VectorXd r = Eigen::VectorXd::Constant(1, 7.0);
  const Eigen::VectorXd x = target.N_x * r, u = target.N_u * r;
  EXPECT_LT((plant.A * x + plant.B * u - x).norm(), 1e-12);
  EXPECT_NEAR((plant.C * x)[0], 7.0, 1e-12);
  EXPECT_LT(target.miss(plant, {0}, r), 1e-12);
}

TEST(SteadyState, SaysHowFarOffAReferenceIsThatCannotBeHeld) {
  // A position cannot stay while the speed is not zero.
  const DiscretePlant plant = sample_plant(double_integrator(), kSampleTime_s);
  const SteadyState target = steady_state(plant, {0, 1});
  EXPECT_LT(target.miss(plant, {0, 1}, Eigen::Vector2d(1.0, 0.0)), 1e-12);
  EXPECT_GT(target.miss(plant, {0, 1}, Eigen::Vector2d(0.0, 1.0)), 0.05);
}

}  // namespace
}  // namespace faultline

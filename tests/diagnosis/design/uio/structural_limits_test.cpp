#include "diagnosis/design/uio/structural_limits.h"

#include <cmath>
#include <optional>

#include <gtest/gtest.h>

#include "diagnosis/design/uio/decoupling.h"
#include "diagnosis/design/uio/limit_text.h"
#include "diagnosis/design/uio/observer_plant.h"
#include "tests/diagnosis/flexible_joint.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;

constexpr FrequencyBand kLowBand{0.0, 0.1};

struct Joint {
  ObserverModel model;
  DecouplingMatrices decoupling;
};

// The robot, stepped by Euler, with or without its sensor fault as a state, decoupled or not.
Joint joint(const ObserverTask& task, bool is_decoupling) {
  const PlantModel plant = flexible_joint_euler();
  const BankRequest request = joint_request("");
  const ObserverPlant sampled = observer_plant(plant, request);
  const ObserverModel model = observer_model(plant, request, sampled, task, {});
  const MatrixXd D = is_decoupling ? MatrixXd(model.M.leftCols(3)) : MatrixXd(model.n(), 0);
  return {model, decoupling_matrices(split_decouplable(D, model.C).D_1, model.C)};
}

const ObserverTask kPlain{{}, {0}, 0.0};
const ObserverTask kCarryingY1{{1}, {0}, 0.001};

TEST(StructuralLimits, FindsThatAConstantActuatorFaultLooksLikeASensorFault) {
  const Joint blind = joint(kCarryingY1, true);
  const auto hidden = hidden_fault(blind.model, blind.decoupling, kLowBand);
  ASSERT_TRUE(hidden.has_value());
  EXPECT_EQ(hidden->angle_rad, 0.0);
  EXPECT_EQ(hidden->m[0], 1.0);
  // The estimate is 0.478 times the fault: e = (.., -0.478), m̂ = -e.
  EXPECT_NEAR(hidden->e[4].real(), -0.478, 5e-4);
  // It solves its equations, so no gain can see it.
  const MatrixXd& S = blind.decoupling.S;
  const Eigen::VectorXd e = hidden->e.real();
  EXPECT_LT((e - S * blind.model.A * e - S * blind.model.F_x * hidden->m.real()).norm(), 1e-9);
  EXPECT_LT((blind.model.C * e).norm(), 1e-9);
  const std::string text = hidden_fault_text(flexible_joint_euler(), kCarryingY1, *hidden, true);
  EXPECT_NE(text.find("a constant u1 of 1 looks exactly like y1 of 0.478"), std::string::npos)
      << text;
}

TEST(StructuralLimits, FindsNothingWhereThereIsAnObserver) {
  for (const auto& [task, is_decoupling] :
       {std::pair(kPlain, true), std::pair(kPlain, false), std::pair(kCarryingY1, false)}) {
    const Joint seeing = joint(task, is_decoupling);
    EXPECT_FALSE(hidden_fault(seeing.model, seeing.decoupling, kLowBand).has_value());
    EXPECT_FALSE(fixed_mode(seeing.model, seeing.decoupling).has_value());
  }
}

TEST(StructuralLimits, FindsTheInvariantZeroThatDecouplingTheSensorFaultToo) {
  // T = D (C D)⁺ with the fault state's drift among the directions leaves a mode at 1.709.
  const Joint carried = joint(kCarryingY1, false);
  MatrixXd D(5, 4);
  D << carried.model.M.leftCols(3), MatrixXd::Identity(5, 5).col(4);
  const DecouplingMatrices all =
      decoupling_matrices(split_decouplable(D, carried.model.C).D_1, carried.model.C);
  ASSERT_EQ(all.D_1.cols(), 3);
  const auto mode = fixed_mode(carried.model, all);
  ASSERT_TRUE(mode.has_value());
  EXPECT_NEAR(mode->lambda.real(), 1.709, 1e-3);
  EXPECT_NE(fixed_mode_text(*mode, true).find("1.709"), std::string::npos);
}

TEST(StructuralLimits, FindsAnUnstableModeThatNoOutputSees) {
  ObserverModel model;
  model.A = Eigen::Vector2d(1.1, 0.5).asDiagonal();
  model.C = Eigen::RowVector2d(0.0, 1.0);
  model.E_o = MatrixXd(2, 0);
  model.E_i = MatrixXd(0, 2);
  const DecouplingMatrices none = decoupling_matrices(MatrixXd(2, 0), model.C);
  const auto mode = fixed_mode(model, none);
  ASSERT_TRUE(mode.has_value());
  EXPECT_NEAR(std::abs(mode->lambda), 1.1, 1e-12);
  model.A(0, 0) = 0.9;
  EXPECT_FALSE(fixed_mode(model, none).has_value());
  // .. and one that only a corner of the slopes makes unstable.
  model.E_o = Eigen::Vector2d::UnitX();
  model.E_i = Eigen::RowVector2d(1.0, 0.0);
  model.slope_radius = Eigen::VectorXd::Constant(1, 0.3);
  const auto corner = fixed_mode(model, none);
  ASSERT_TRUE(corner.has_value());
  EXPECT_EQ(corner->vertex, 1);
}

TEST(StructuralLimits, FindAFaultHiddenInsideTheBandOnly) {
  // A transmission zero from the fault at angle 0.5: e' = rotation e + b m, y = c e.
  const double angle = 0.5;
  ObserverModel model;
  model.A = MatrixXd(3, 3);
  model.A << 0.2, 0, 0, 0, 0.3, 0, 0, 0, 0.4;
  model.C = Eigen::RowVector3d(1.0, 1.0, 1.0);
  model.E_o = MatrixXd(3, 0);
  model.E_i = MatrixXd(0, 3);
  model.F_y = MatrixXd::Zero(1, 1);
  // Residues b_i of (z² - 2 cos(angle) z + 1) / Π (z - a_i).
  model.F_x = MatrixXd(3, 1);
  const double a[] = {0.2, 0.3, 0.4};
  for (int i = 0; i < 3; ++i) {
    double denominator = 1.0;
    for (int j = 0; j < 3; ++j) denominator *= i == j ? 1.0 : a[i] - a[j];
    model.F_x(i, 0) = (a[i] * a[i] - 2.0 * std::cos(angle) * a[i] + 1.0) / denominator;
  }
  const DecouplingMatrices none = decoupling_matrices(MatrixXd(3, 0), model.C);
  EXPECT_FALSE(hidden_fault(model, none, {0.0, 0.4}).has_value());
  const auto hidden = hidden_fault(model, none, {angle, 1.0});
  ASSERT_TRUE(hidden.has_value());
  EXPECT_EQ(hidden->angle_rad, angle);
}

}  // namespace
}  // namespace faultline

#include "diagnosis/design/balance.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "tests/diagnosis/hou_plant.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd gaussian(Index rows, Index cols, std::mt19937_64& engine) {
  std::normal_distribution<double> normal;
  return MatrixXd::NullaryExpr(rows, cols, [&] { return normal(engine); });
}

TEST(Balance, LeavesAPlantInSaneUnitsAlone) {
  const PlantModel plant = hou_plant();
  const Balance units = balance(plant.A, plant.C, {plant.B, MatrixXd::Zero(3, 4)});
  EXPECT_TRUE((units.state.array() == 1.0).all());
  EXPECT_TRUE((units.output.array() == 1.0).all());
}

TEST(Balance, UndoesScalesOfStatesAndOutputs) {
  const std::uint64_t seed = test_seed(40);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  for (int trial = 0; trial < 50; ++trial) {
    const MatrixXd A = gaussian(6, 6, engine);
    const MatrixXd C = gaussian(3, 6, engine);
    const MatrixXd L = gaussian(6, 2, engine);
    std::uniform_real_distribution<double> exponent(-6.0, 6.0);
    const auto scale = [&] { return std::pow(10.0, exponent(engine)); };
    const VectorXd t = VectorXd::NullaryExpr(6, scale);
    const VectorXd s = VectorXd::NullaryExpr(3, scale);
    const MatrixXd A_scaled = t.asDiagonal() * A * t.cwiseInverse().asDiagonal();
    const MatrixXd C_scaled = s.asDiagonal() * C * t.cwiseInverse().asDiagonal();
    const Balance units = balance(A_scaled, C_scaled, {t.asDiagonal() * L, MatrixXd::Zero(3, 2)});
    // Each unit is a power of 16, and none is off by more than two of them from what was done.
    const MatrixXd A_balanced = units.of_state(A_scaled);
    EXPECT_LT(A_balanced.norm(), 64.0 * A.norm());
    const VectorXd rows = units.of_output(C_scaled).rowwise().norm();
    EXPECT_LT(rows.maxCoeff(), 64.0 * rows.minCoeff());
    for (const double unit : units.state) {
      EXPECT_EQ(std::remainder(std::log2(unit), 4.0), 0.0);
    }
  }
}

TEST(Balance, SurvivesZerosAndHugeNumbers) {
  MatrixXd A = MatrixXd::Zero(3, 3);
  A(0, 1) = 1e300;
  A(1, 2) = 1e-300;
  const Balance units =
      balance(A, MatrixXd::Zero(2, 3), {MatrixXd::Zero(3, 0), MatrixXd::Zero(2, 0)});
  EXPECT_TRUE(units.state.allFinite() && (units.state.array() > 0.0).all());
  EXPECT_TRUE(units.output.allFinite() && (units.output.array() > 0.0).all());
}

}  // namespace
}  // namespace faultline

#include "diagnosis/certify/balance.h"

#include <random>

#include <gtest/gtest.h>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd gaussian(std::mt19937_64& engine, Index rows, Index cols) {
  std::normal_distribution<double> normal;
  return MatrixXd::NullaryExpr(rows, cols, [&] { return normal(engine); });
}

TEST(StateScales, AreOnesForAPlantInSaneUnits) {
  std::mt19937_64 engine(test_seed(1));
  const MatrixXd A = gaussian(engine, 6, 6);
  EXPECT_EQ(state_scales(A, gaussian(engine, 6, 2), gaussian(engine, 3, 6)), VectorXd::Ones(6));
}

TEST(StateScales, UndoRawScalingUpToAFactorOfFour) {
  const std::uint64_t seed = test_seed(2);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  const MatrixXd A = gaussian(engine, 5, 5);
  const MatrixXd B = gaussian(engine, 5, 2);
  const MatrixXd C = gaussian(engine, 3, 5);
  const VectorXd raw = (VectorXd(5) << 1e4, 1.0, 1e-4, 1e2, 1e-8).finished();
  const VectorXd found = state_scales(raw.asDiagonal() * A * raw.cwiseInverse().asDiagonal(),
                                      raw.asDiagonal() * B, C * raw.cwiseInverse().asDiagonal());
  const VectorXd left = found.cwiseQuotient(raw);
  EXPECT_LT(left.maxCoeff() / left.minCoeff(), 4.0);
}

TEST(StateScales, ArePowersOfTwo) {
  MatrixXd A = MatrixXd::Identity(2, 2);
  A(0, 1) = 1e9;
  A(1, 0) = 1e-9;
  for (const double scale : state_scales(A, MatrixXd(2, 0), MatrixXd(0, 2))) {
    EXPECT_EQ(scale, power_of_two(scale));
  }
}

TEST(StateScales, SurviveStatesThatNothingMovesAndThatMoveNothing) {
  MatrixXd A = MatrixXd::Zero(3, 3);
  A(0, 1) = 1e12;
  A(1, 1) = -1.0;
  const VectorXd scales = state_scales(A, MatrixXd::Zero(3, 1), MatrixXd::Zero(1, 3));
  EXPECT_TRUE(scales.allFinite());
  EXPECT_GT(scales.minCoeff(), 0.0);
}

TEST(StateScales, OfNoStateAreNone) {
  EXPECT_EQ(state_scales(MatrixXd(0, 0), MatrixXd(0, 2), MatrixXd(3, 0)).size(), 0);
}

}  // namespace
}  // namespace faultline

#include "diagnosis/model/discretize.h"

#include <cmath>

#include <gtest/gtest.h>

namespace faultline {
namespace {

using Eigen::MatrixXd;

TEST(DiscretizeZoh, IsExactForADoubleIntegrator) {
  const MatrixXd A = (MatrixXd(2, 2) << 0, 1, 0, 0).finished();
  const MatrixXd B = (MatrixXd(2, 1) << 0, 1).finished();
  const SampledSystem sampled = discretize_zoh(A, B, 0.5);
  EXPECT_LT((sampled.A - (MatrixXd(2, 2) << 1, 0.5, 0, 1).finished()).norm(), 1e-15);
  EXPECT_LT((sampled.B - (MatrixXd(2, 1) << 0.125, 0.5).finished()).norm(), 1e-15);
}

TEST(DiscretizeZoh, IsExactForAScalarOverFastAndSlowPoles) {
  for (const double a : {-1e3, -10.0, -1e-6, 3.0}) {
    const SampledSystem sampled =
        discretize_zoh(MatrixXd::Constant(1, 1, a), MatrixXd::Constant(1, 1, 2.0), 0.1);
    EXPECT_NEAR(sampled.A(0, 0), std::exp(0.1 * a), 1e-14 * std::exp(0.1 * std::max(a, 0.0)));
    EXPECT_NEAR(sampled.B(0, 0), 2.0 * std::expm1(0.1 * a) / a, 1e-14);
  }
}

TEST(DiscretizeZoh, OfTwoHalfStepsIsTheWholeStep) {
  const MatrixXd A = (MatrixXd(3, 3) << 1, 1, 1, 0, -1, 2, 2, 0, -4).finished();
  const MatrixXd B = (MatrixXd(3, 1) << 1, 2, 3).finished();
  const SampledSystem whole = discretize_zoh(A, B, 2.0);
  const SampledSystem half = discretize_zoh(A, B, 1.0);
  EXPECT_LT((whole.A - half.A * half.A).norm(), 1e-13 * whole.A.norm());
  EXPECT_LT((whole.B - half.A * half.B - half.B).norm(), 1e-13 * whole.B.norm());
}

TEST(DiscretizeEuler, IsOneStepAlongTheTangent) {
  const MatrixXd A = (MatrixXd(2, 2) << 1, 2, 3, -4).finished();
  const MatrixXd B = (MatrixXd(2, 1) << 5, -6).finished();
  const SampledSystem sampled = discretize_euler(A, B, 0.25);
  EXPECT_EQ(sampled.A, (MatrixXd(2, 2) << 1.25, 0.5, 0.75, 0.0).finished());
  EXPECT_EQ(sampled.B, (MatrixXd(2, 1) << 1.25, -1.5).finished());
}

TEST(DiscretizeEuler, MissesTheExactSamplingByTheSquareOfTheSampleTime) {
  const MatrixXd A = (MatrixXd(2, 2) << 0, 1, -4, -0.5).finished();
  const MatrixXd B = (MatrixXd(2, 1) << 1, 2).finished();
  const auto error = [&](double T) {
    const SampledSystem exact = discretize_zoh(A, B, T);
    const SampledSystem euler = discretize_euler(A, B, T);
    return (exact.A - euler.A).norm() + (exact.B - euler.B).norm();
  };
  EXPECT_NEAR(error(1e-3) / error(5e-4), 4.0, 0.01);
}

TEST(DiscretizeFoh, IsExactForARampThroughASingularSystem) {
  // x1' = x2, x2' = v with v = 1 + t over [0, 1]: x2 = 1 + 1/2, x1 = 1/2 + 1/6.
  const MatrixXd A = (MatrixXd(2, 2) << 0, 1, 0, 0).finished();
  const MatrixXd B = (MatrixXd(2, 1) << 0, 1).finished();
  const FirstOrderHoldSystem sampled = discretize_foh(A, B, 1.0);
  const Eigen::Vector2d x = sampled.B_0 * 1.0 + sampled.B_1 * 2.0;
  EXPECT_NEAR(x[0], 2.0 / 3.0, 1e-15);
  EXPECT_NEAR(x[1], 1.5, 1e-15);
}

TEST(DiscretizeFoh, OfAConstantIsTheZeroOrderHold) {
  const MatrixXd A = (MatrixXd(2, 2) << -3, 1, 0.5, -7).finished();
  const MatrixXd B = MatrixXd::Identity(2, 2);
  const FirstOrderHoldSystem foh = discretize_foh(A, B, 0.2);
  const SampledSystem zoh = discretize_zoh(A, B, 0.2);
  EXPECT_LT((foh.A - zoh.A).norm(), 1e-15);
  EXPECT_LT((foh.B_0 + foh.B_1 - zoh.B).norm(), 1e-15);
}

TEST(Discretize, KeepsEmptySystemsEmpty) {
  const FirstOrderHoldSystem sampled = discretize_foh(MatrixXd(0, 0), MatrixXd(0, 2), 0.1);
  EXPECT_EQ(sampled.A.size(), 0);
  EXPECT_EQ(sampled.B_1.cols(), 2);
}

TEST(Discretize, LosesNoDigitsToInputsInSmallUnits) {
  const MatrixXd A = (MatrixXd(2, 2) << -1.0, 2.0, -3.0, -0.5).finished();
  const MatrixXd B = (MatrixXd(2, 2) << 1.0, 0.5, 0.0, 2.0).finished();
  const double unit = std::exp2(40.0);
  MatrixXd B_large = B;
  B_large.col(1) *= unit;
  const SampledSystem held = discretize_zoh(A, B, 0.01);
  const SampledSystem held_large = discretize_zoh(A, B_large, 0.01);
  EXPECT_LT((held_large.A - held.A).norm(), 1e-15);
  EXPECT_LT((held_large.B.col(1) / unit - held.B.col(1)).norm(), 1e-15);
  const FirstOrderHoldSystem line = discretize_foh(A, B, 0.01);
  const FirstOrderHoldSystem line_large = discretize_foh(A, B_large, 0.01);
  EXPECT_LT((line_large.A - line.A).norm(), 1e-15);
  EXPECT_LT((line_large.B_0.col(1) / unit - line.B_0.col(1)).norm(), 1e-15);
  EXPECT_LT((line_large.B_1.col(1) / unit - line.B_1.col(1)).norm(), 1e-15);
}

}  // namespace
}  // namespace faultline

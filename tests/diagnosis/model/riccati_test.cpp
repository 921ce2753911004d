#include "diagnosis/model/riccati.h"

#include <stdexcept>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "tests/support/eigenvalues.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;

/// Puts X back into the equation.
double residual(const MatrixXd& A, const MatrixXd& B, const MatrixXd& Q, const MatrixXd& R,
                const MatrixXd& X) {
  const MatrixXd XA = X * A;
  const MatrixXd XB = X * B;
  return (A.transpose() * XA -
          A.transpose() * XB * (R + B.transpose() * XB).inverse() * B.transpose() * XA + Q - X)
      .norm();
}

TEST(SolveDare, SolvesAScalarEquation) {
  // x = x - x²/(1 + x) + 1, i.e. x² - x - 1 = 0: the golden ratio.
  const MatrixXd one = MatrixXd::Ones(1, 1);
  EXPECT_NEAR(solve_dare(one, one, one, one)(0, 0), 0.5 * (1.0 + std::sqrt(5.0)), 1e-14);
}

TEST(SolveDare, FulfilsItsEquationAndStabilises) {
  const MatrixXd A = (MatrixXd(3, 3) << 1.2, 0.3, 0, 0, 0.9, 0.5, 0.1, 0, 1.01).finished();
  const MatrixXd B = (MatrixXd(3, 2) << 1, 0, 0, 1, 0.5, 0.5).finished();
  const MatrixXd Q = MatrixXd::Identity(3, 3);
  const MatrixXd R = 0.1 * MatrixXd::Identity(2, 2);
  const MatrixXd X = solve_dare(A, B, Q, R);
  EXPECT_LT(residual(A, B, Q, R, X), 1e-12 * X.norm());
  EXPECT_LT((X - X.transpose()).norm(), 1e-15 * X.norm());
  const MatrixXd K = lqr_gain(A, B, Q, R);
  for (const std::complex<double> value : sorted_eigenvalues(A - B * K)) {
    EXPECT_LT(std::abs(value), 1.0);
  }
}

TEST(SolveDare, RefusesWhatHasNoStabilisingSolution) {
  const MatrixXd A = 2.0 * MatrixXd::Identity(2, 2);
  const MatrixXd B = (MatrixXd(2, 1) << 1, 0).finished();
  const MatrixXd I = MatrixXd::Identity(2, 2);
  EXPECT_THROW(static_cast<void>(solve_dare(A, B, I, MatrixXd::Ones(1, 1))), std::invalid_argument);
}

TEST(SolveDare, RefusesWrongShapesAndIndefiniteWeights) {
  const MatrixXd I = MatrixXd::Identity(2, 2);
  EXPECT_THROW(static_cast<void>(solve_dare(I, MatrixXd::Ones(3, 1), I, I)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(solve_dare(I, I, I, -I)), std::invalid_argument);
}

TEST(SolveCare, SolvesAScalarEquation) {
  // 0 = 2 x - x² + 3: x = 3.
  const MatrixXd one = MatrixXd::Ones(1, 1);
  EXPECT_NEAR(solve_care(one, one, 3.0 * one, one)(0, 0), 3.0, 1e-13);
}

TEST(SolveCare, FulfilsItsEquationAndStabilises) {
  const MatrixXd A = (MatrixXd(3, 3) << 1.2, 0.3, 0, 0, -0.9, 0.5, 40.0, 0, 0.0).finished();
  const MatrixXd B = (MatrixXd(3, 2) << 1, 0, 0, 1, 0.5, 0.5).finished();
  const MatrixXd Q = MatrixXd::Identity(3, 3);
  const MatrixXd R = 0.1 * MatrixXd::Identity(2, 2);
  const MatrixXd X = solve_care(A, B, Q, R);
  const MatrixXd XBRB = X * B * R.inverse() * B.transpose();
  EXPECT_LT((A.transpose() * X + X * A - XBRB * X + Q).norm(), 1e-11 * (X * A).norm());
  for (const std::complex<double> value :
       sorted_eigenvalues(A - B * R.inverse() * B.transpose() * X)) {
    EXPECT_LT(value.real(), 0.0);
  }
}

TEST(SolveCare, RefusesWhatCannotBeStabilised) {
  const MatrixXd A = MatrixXd::Identity(2, 2);
  const MatrixXd B = MatrixXd::Zero(2, 1);
  EXPECT_THROW(static_cast<void>(solve_care(A, B, MatrixXd::Identity(2, 2), MatrixXd::Ones(1, 1))),
               std::invalid_argument);
}

}  // namespace
}  // namespace faultline

#include "diagnosis/certify/orthogonal.h"

#include <random>

#include <gtest/gtest.h>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

MatrixXd gaussian(std::mt19937_64& engine, Index rows, Index cols) {
  std::normal_distribution<double> normal;
  return MatrixXd::NullaryExpr(rows, cols, [&] { return normal(engine); });
}

void expect_orthonormal(const MatrixXd& X) {
  EXPECT_LT((X.transpose() * X - MatrixXd::Identity(X.cols(), X.cols())).norm(), 1e-13);
}

TEST(OrthogonalArithmetic, SplitsSpaceIntoImageAndComplement) {
  std::mt19937_64 engine(test_seed(3));
  const MatrixXd X = gaussian(engine, 6, 2) * gaussian(engine, 2, 4);
  OrthogonalArithmetic arithmetic(1e-9);
  const OrthogonalArithmetic::Split split = arithmetic.split(X, X.norm());
  EXPECT_EQ(split.inside.cols(), 2);
  EXPECT_EQ(split.outside.cols(), 4);
  expect_orthonormal(split.inside);
  expect_orthonormal(split.outside);
  EXPECT_LT((split.outside.transpose() * X).norm(), 1e-13 * X.norm());
  EXPECT_LT((split.outside.transpose() * split.inside).norm(), 1e-13);
}

TEST(OrthogonalArithmetic, FindsTheKernel) {
  std::mt19937_64 engine(test_seed(4));
  const MatrixXd X = gaussian(engine, 5, 3) * gaussian(engine, 3, 7);
  OrthogonalArithmetic arithmetic(1e-9);
  const MatrixXd kernel = arithmetic.kernel(X, X.norm());
  EXPECT_EQ(kernel.cols(), 4);
  expect_orthonormal(kernel);
  EXPECT_LT((X * kernel).norm(), 1e-13 * X.norm());
}

TEST(OrthogonalArithmetic, GivesTheShortestOfTheNearestSolutions) {
  std::mt19937_64 engine(test_seed(5));
  const MatrixXd X = gaussian(engine, 5, 2) * gaussian(engine, 2, 4);
  const MatrixXd Y = gaussian(engine, 5, 3);
  OrthogonalArithmetic arithmetic(1e-9);
  const MatrixXd s = arithmetic.shortest_solution(X, X.norm(), Y);
  EXPECT_LT((X.transpose() * (X * s - Y)).norm(), 1e-12 * Y.norm());  // nearest
  const MatrixXd kernel = arithmetic.kernel(X, X.norm());
  EXPECT_LT((kernel.transpose() * s).norm(), 1e-13 * (1.0 + s.norm()));  // shortest
}

TEST(OrthogonalArithmetic, RecordsHowFarItsDecisionsWereFromFlipping) {
  MatrixXd X = MatrixXd::Zero(3, 3);
  X(0, 0) = 1.0;
  X(1, 1) = 1e-4;
  X(2, 2) = 1e-13;
  OrthogonalArithmetic arithmetic(1e-9);
  EXPECT_EQ(arithmetic.split(X, 1.0).inside.cols(), 2);
  EXPECT_NEAR(arithmetic.smallest_kept(), 1e-4, 1e-16);
  EXPECT_NEAR(arithmetic.largest_dropped(), 1e-13, 1e-25);
}

TEST(OrthogonalArithmetic, TakesEmptyMatrices) {
  OrthogonalArithmetic arithmetic(1e-9);
  EXPECT_EQ(arithmetic.split(MatrixXd(3, 0), 1.0).outside, MatrixXd::Identity(3, 3));
  EXPECT_EQ(arithmetic.kernel(MatrixXd(0, 3), 1.0), MatrixXd::Identity(3, 3));
  EXPECT_EQ(arithmetic.shortest_solution(MatrixXd(2, 0), 1.0, MatrixXd(2, 1)).rows(), 0);
  EXPECT_EQ(complement_of(MatrixXd(3, 0)), MatrixXd::Identity(3, 3));
}

TEST(OrthonormalBasis, SpansColumnsOfAnySize) {
  MatrixXd X(3, 2);
  X << 1e12, 1.0, 0.0, 1e-3, 0.0, 0.0;
  const MatrixXd basis = orthonormal_basis(X);
  expect_orthonormal(basis);
  EXPECT_LT(basis.row(2).norm(), 1e-15);
}

}  // namespace
}  // namespace faultline

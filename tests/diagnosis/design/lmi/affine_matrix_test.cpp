#include "diagnosis/design/lmi/affine_matrix.h"

#include <gtest/gtest.h>

#include "diagnosis/design/lmi/lmi_problem.h"
#include "tests/support/random_plant.h"

namespace faultline {
namespace {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::complex<double> kI(0.0, 1.0);

TEST(AffineMatrix, HasTheValueThatItsExpressionHasWithTheVariablesValues) {
  RandomNumbers random(1);
  LmiProblem problem;
  const AffineMatrix P = problem.symmetric(3);
  const AffineMatrix Y = problem.full(3, 2);
  const AffineMatrix t = problem.scalar();
  const MatrixXd A = random.normal(3, 3);
  const MatrixXd C = random.normal(2, 3);
  const VectorXd x = random.normal(problem.variable_count(), 1);
  const MatrixXcd P_x = P.at(x);
  const MatrixXcd Y_x = Y.at(x);
  const MatrixXcd t_x = t.at(x);

  const AffineMatrix E = A.transpose() * P * A - Y * C + kI * Y.adjoint().adjoint() * C -
                         multiple_of(A, t) + AffineMatrix(A);
  const MatrixXcd expected = A.transpose() * P_x * A - Y_x * C + kI * Y_x * C - t_x(0, 0) * A + A;
  EXPECT_LT((E.at(x) - expected).norm(), 1e-12 * expected.norm());

  const AffineMatrix row = beside({P, Y, AffineMatrix(3, 0)});
  EXPECT_EQ(row.cols(), 5);
  EXPECT_EQ(row.at(x).leftCols(3), P_x);
  EXPECT_EQ(row.at(x).rightCols(2), Y_x);
}

TEST(AffineMatrix, OfBlockRowsIsHermitianAndHasThemAboveItsDiagonal) {
  RandomNumbers random(2);
  LmiProblem problem;
  const AffineMatrix P = problem.hermitian(2);
  const AffineMatrix Y = problem.full(2, 3);
  const AffineMatrix d = problem.full(3, 1);
  const VectorXd x = random.normal(problem.variable_count(), 1);
  const AffineMatrix E = hermitian({{P, {2, 0}, kI * Y}, {{0, 0}, {0, 3}}, {diagonal(d)}});
  const MatrixXcd value = E.at(x);
  ASSERT_EQ(value.rows(), 5);
  EXPECT_EQ(value, value.adjoint());
  EXPECT_EQ(value.topLeftCorner(2, 2), P.at(x));
  EXPECT_EQ(value.topRightCorner(2, 3), (kI * Y).at(x));
  EXPECT_EQ(value.bottomRightCorner(3, 3), MatrixXcd(d.at(x).col(0).asDiagonal()));
}

TEST(AffineMatrix, OfAHermitianVariableReachesEveryHermitianMatrix) {
  LmiProblem problem;
  const AffineMatrix P = problem.hermitian(3);
  EXPECT_EQ(problem.variable_count(), 9);
  MatrixXcd images(9, 9);
  for (Eigen::Index k = 0; k < 9; ++k) {
    const MatrixXcd basis = P.at(VectorXd::Unit(9, k));
    EXPECT_EQ(basis, basis.adjoint());
    images.col(k) = basis.reshaped();
  }
  // Orthogonal and not zero: independent.
  const MatrixXcd products = images.adjoint() * images;
  EXPECT_TRUE(products.isDiagonal(1e-15));
  EXPECT_GE(products.diagonal().real().minCoeff(), 1.0);
}

TEST(AffineMatrix, KeepsNoTermThatCancels) {
  LmiProblem problem;
  const AffineMatrix Y = problem.full(2, 2);
  EXPECT_TRUE((Y - Y).terms().empty());
  EXPECT_EQ((Y + Y).terms().size(), 4U);
}

}  // namespace
}  // namespace faultline

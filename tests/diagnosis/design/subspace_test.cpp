#include "diagnosis/design/subspace.h"

#include <gtest/gtest.h>

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;

MatrixXd projector(const MatrixXd& basis) { return basis * basis.transpose(); }

TEST(SubspaceArithmetic, FindsTheImageAndTheKernelOfASingularMatrix) {
  const MatrixXd X = (MatrixXd(3, 3) << 1, 2, 3, 2, 4, 6, 0, 0, 1).finished();
  SubspaceArithmetic arithmetic;
  const MatrixXd image = arithmetic.image(X, X.norm());
  const MatrixXd kernel = arithmetic.kernel(X, X.norm());
  ASSERT_EQ(image.cols(), 2);
  ASSERT_EQ(kernel.cols(), 1);
  EXPECT_LT((projector(image) * X - X).norm(), 1e-14);
  EXPECT_LT((X * kernel).norm(), 1e-14);
}

TEST(SubspaceArithmetic, CallsAMatrixOfRoundingErrorsZero) {
  SubspaceArithmetic arithmetic;
  const MatrixXd noise = 1e-15 * MatrixXd::Ones(3, 3);
  EXPECT_EQ(arithmetic.image(noise, 1.0).cols(), 0);
  EXPECT_EQ(arithmetic.kernel(noise, 1.0).cols(), 3);
}

TEST(SubspaceArithmetic, IntersectsTwoPlanesInALine) {
  SubspaceArithmetic arithmetic;
  const MatrixXd xy = MatrixXd::Identity(3, 2);
  const MatrixXd yz = MatrixXd::Identity(3, 3).rightCols(2);
  const MatrixXd line = arithmetic.intersection(xy, yz);
  ASSERT_EQ(line.cols(), 1);
  EXPECT_LT((projector(line) - projector(Vector3d::UnitY())).norm(), 1e-14);
  EXPECT_EQ(arithmetic.sum(xy, yz).cols(), 3);
}

TEST(SubspaceArithmetic, TakesThePreImageUnderASingularMatrix) {
  // A maps x onto y and forgets y, z: everything that A sends into span(y) is all of R^3.
  MatrixXd A = MatrixXd::Zero(3, 3);
  A(1, 0) = 2.0;
  SubspaceArithmetic arithmetic;
  EXPECT_EQ(arithmetic.preimage(A, Vector3d::UnitY(), A.norm()).cols(), 3);
  EXPECT_EQ(arithmetic.preimage(A, Vector3d::UnitX(), A.norm()).cols(), 2);
}

TEST(SubspaceArithmetic, TellsHowFarItsDecisionsWereFromFlipping) {
  SubspaceArithmetic arithmetic;
  const MatrixXd X = Vector3d(1.0, 1e-5, 1e-13).asDiagonal();
  EXPECT_EQ(arithmetic.image(X, 1.0).cols(), 2);
  EXPECT_NEAR(arithmetic.margin().smallest_kept, 1e-5, 1e-18);
  EXPECT_NEAR(arithmetic.margin().largest_dropped, 1e-13, 1e-18);
}

TEST(SubspaceArithmetic, WorksOnEmptySubspaces) {
  SubspaceArithmetic arithmetic;
  const MatrixXd nothing(3, 0);
  EXPECT_EQ(arithmetic.sum(nothing, nothing).cols(), 0);
  EXPECT_EQ(complement(nothing).cols(), 3);
  EXPECT_EQ(arithmetic.intersection(nothing, MatrixXd::Identity(3, 3)).cols(), 0);
}

TEST(SubspaceArithmetic, PseudoInverseFulfilsPenrosesEquations) {
  const MatrixXd X = (MatrixXd(3, 2) << 1, 2, 2, 4, 3, 6).finished();
  const MatrixXd Y = SubspaceArithmetic().pseudo_inverse(X, X.norm());
  EXPECT_LT((X * Y * X - X).norm(), 1e-13);
  EXPECT_LT((Y * X * Y - Y).norm(), 1e-13);
  EXPECT_LT((X * Y - (X * Y).transpose()).norm(), 1e-13);
  EXPECT_LT((Y * X - (Y * X).transpose()).norm(), 1e-13);
}

TEST(CanonicalRows, DependOnTheSubspaceOnly) {
  const MatrixXd basis =
      SubspaceArithmetic().image((MatrixXd(4, 2) << 1, 0, 2, 1, 0, 1, -1, 3).finished(), 1.0);
  const MatrixXd rotation = (MatrixXd(2, 2) << 0.6, 0.8, -0.8, 0.6).finished();
  const MatrixXd rows = canonical_rows(projector(basis), 2);
  EXPECT_LT((rows - canonical_rows(projector(basis * rotation), 2)).norm(), 1e-14);
  EXPECT_LT((rows.transpose() * rows - projector(basis)).norm(), 1e-14);
}

TEST(CanonicalRows, HaveTheirLargestEntryPositiveAndTheFirstOfEquals) {
  const MatrixXd rows = canonical_rows(projector(Vector3d(0.0, -1.0, 1.0).normalized()), 1);
  EXPECT_NEAR(rows(0, 1), std::sqrt(0.5), 1e-15);
  EXPECT_NEAR(rows(0, 2), -std::sqrt(0.5), 1e-15);
}

}  // namespace
}  // namespace faultline

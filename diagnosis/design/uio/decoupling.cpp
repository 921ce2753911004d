#include "diagnosis/design/uio/decoupling.h"

#include <Eigen/SVD>

#include "diagnosis/design/subspace.h"

namespace faultline {

using Eigen::Index;
using Eigen::MatrixXd;

namespace {

// SVD of X = U Σ V', with how many singular values are above the tolerance times `scale`.
struct Decomposition {
  MatrixXd U, V;
  Eigen::VectorXd values;
  Index rank = 0;
};

Decomposition decompose(const MatrixXd& X, double scale) {
  const Eigen::JacobiSVD<MatrixXd> svd(X, Eigen::ComputeThinU | Eigen::ComputeFullV);
  const auto rank =
      static_cast<Index>((svd.singularValues().array() > kRankTolerance * scale).count());
  return {svd.matrixU(), svd.matrixV(), svd.singularValues(), rank};
}

}  // namespace

DecouplableDirections split_decouplable(const MatrixXd& D, const MatrixXd& C) {
  if (D.size() == 0 || D.isZero(0.0)) {
    return {MatrixXd(D.rows(), 0), MatrixXd(D.rows(), 0)};
  }
  const Decomposition columns = decompose(D, D.norm());
  const MatrixXd D_h =
      columns.U.leftCols(columns.rank) * columns.values.head(columns.rank).asDiagonal();
  const Decomposition seen = decompose(C * D_h, C.norm() * D_h.norm());
  return {D_h * seen.V.leftCols(seen.rank), D_h * seen.V.rightCols(D_h.cols() - seen.rank)};
}

DecouplingMatrices decoupling_matrices(const MatrixXd& D_1, const MatrixXd& C) {
  const Index n = C.cols();
  DecouplingMatrices matrices{MatrixXd::Zero(n, C.rows()), MatrixXd::Identity(n, n), D_1};
  if (D_1.cols() == 0) return matrices;
  SubspaceArithmetic arithmetic;
  const MatrixXd C_D = C * D_1;
  matrices.T = D_1 * arithmetic.pseudo_inverse(C_D, C_D.norm());
  matrices.S -= matrices.T * C;
  return matrices;
}

std::vector<std::size_t> annihilated_columns(const MatrixXd& S, const MatrixXd& D) {
  std::vector<std::size_t> columns;
  for (Index j = 0; j < D.cols(); ++j) {
    if ((S * D.col(j)).norm() <= kRankTolerance * D.col(j).norm()) {
      columns.push_back(static_cast<std::size_t>(j));
    }
  }
  return columns;
}

}  // namespace faultline

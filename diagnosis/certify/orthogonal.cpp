#include "diagnosis/certify/orthogonal.h"

#include <algorithm>
#include <cmath>

#include <Eigen/QR>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

using PivotedQr = Eigen::ColPivHouseholderQR<MatrixXd>;

}  // namespace

Index OrthogonalArithmetic::count_pivots(const VectorXd& pivots, double scale) {
  Index rank = 0;
  for (const double pivot : pivots) {
    const double relative = scale > 0.0 ? std::abs(pivot) / scale : 0.0;
    if (relative > tolerance_) {
      smallest_kept_ = std::min(smallest_kept_, relative);
      ++rank;
    } else {
      largest_dropped_ = std::max(largest_dropped_, relative);
    }
  }
  return rank;
}

OrthogonalArithmetic::Split OrthogonalArithmetic::split(const MatrixXd& X, double scale) {
  const Index n = X.rows();
  if (X.size() == 0) {
    return {MatrixXd(n, 0), MatrixXd::Identity(n, n)};
  }
  const PivotedQr qr(X);
  const Index rank = count_pivots(qr.matrixQR().diagonal(), scale);
  const MatrixXd Q = qr.householderQ() * MatrixXd::Identity(n, n);
  return {Q.leftCols(rank), Q.rightCols(n - rank)};
}

MatrixXd OrthogonalArithmetic::kernel(const MatrixXd& X, double scale) {
  return split(X.transpose(), scale).outside;
}

MatrixXd OrthogonalArithmetic::shortest_solution(const MatrixXd& X, double scale,
                                                 const MatrixXd& Y) {
  if (X.size() == 0) {
    return MatrixXd::Zero(X.cols(), Y.cols());
  }
  // X Π = Q [R; 0] with R rank×cols, R^T = Z [U; 0]: X = Q U^T Z^T Π^T, the complete orthogonal
  // decomposition.
  const PivotedQr qr(X);
  const Index rank = count_pivots(qr.matrixQR().diagonal(), scale);
  const MatrixXd R = qr.matrixQR().topRows(rank).triangularView<Eigen::Upper>();
  const MatrixXd Q = qr.householderQ() * MatrixXd::Identity(X.rows(), rank);
  const Eigen::HouseholderQR<MatrixXd> rows(R.transpose());
  const MatrixXd U = rows.matrixQR().topRows(rank).triangularView<Eigen::Upper>();
  const MatrixXd Z = rows.householderQ() * MatrixXd::Identity(X.cols(), rank);
  const MatrixXd core = U.transpose().triangularView<Eigen::Lower>().solve(Q.transpose() * Y);
  return qr.colsPermutation() * (Z * core);
}

MatrixXd complement_of(const MatrixXd& X) {
  const Index n = X.rows();
  if (X.size() == 0) {
    return MatrixXd::Identity(n, n);
  }
  const Eigen::HouseholderQR<MatrixXd> qr(X);
  const MatrixXd Q = qr.householderQ() * MatrixXd::Identity(n, n);
  return Q.rightCols(n - X.cols());
}

MatrixXd orthonormal_basis(const MatrixXd& X) {
  if (X.size() == 0) {
    return X;
  }
  MatrixXd unit = X;
  for (Index j = 0; j < X.cols(); ++j) {
    const double norm = X.col(j).norm();
    unit.col(j) /= norm > 0.0 ? norm : 1.0;
  }
  const PivotedQr qr(unit);
  return qr.householderQ() * MatrixXd::Identity(X.rows(), X.cols());
}

}  // namespace faultline

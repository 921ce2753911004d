#include "diagnosis/design/subspace.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include <Eigen/QR>
#include <Eigen/SVD>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Entries or columns this close to the largest are a tie, and the first one wins: far above
// rounding, so that the choice does not depend on it.
constexpr double kTie = 1.0 - 1e-6;

// The first index whose value is the largest, ties counted.
Index first_largest(const VectorXd& values) {
  const double largest = values.maxCoeff();
  Index i = 0;
  while (values[i] < kTie * largest) {
    ++i;
  }
  return i;
}

}  // namespace

Index SubspaceArithmetic::rank(const VectorXd& singular_values, double scale) {
  Index rank = 0;
  for (const double value : singular_values) {
    const double relative = scale > 0.0 ? value / scale : 0.0;
    if (relative > tolerance_) {
      margin_.smallest_kept = std::min(margin_.smallest_kept, relative);
      ++rank;
    } else {
      margin_.largest_dropped = std::max(margin_.largest_dropped, relative);
    }
  }
  return rank;
}

MatrixXd SubspaceArithmetic::image(const MatrixXd& X, double scale) {
  if (X.size() == 0) {
    return MatrixXd(X.rows(), 0);
  }
  const Eigen::JacobiSVD<MatrixXd> svd(X, Eigen::ComputeThinU);
  return svd.matrixU().leftCols(rank(svd.singularValues(), scale));
}

MatrixXd SubspaceArithmetic::kernel(const MatrixXd& X, double scale) {
  if (X.size() == 0) {
    return MatrixXd::Identity(X.cols(), X.cols());
  }
  const Eigen::JacobiSVD<MatrixXd> svd(X, Eigen::ComputeFullV);
  return svd.matrixV().rightCols(X.cols() - rank(svd.singularValues(), scale));
}

MatrixXd SubspaceArithmetic::sum(const MatrixXd& U, const MatrixXd& V) {
  MatrixXd both(U.rows(), U.cols() + V.cols());
  both << U, V;
  return image(both, 1.0);
}

MatrixXd SubspaceArithmetic::intersection(const MatrixXd& U, const MatrixXd& V) {
  return complement(sum(complement(U), complement(V)));
}

MatrixXd SubspaceArithmetic::preimage(const MatrixXd& A, const MatrixXd& Z, double scale) {
  return kernel(complement(Z).transpose() * A, scale);
}

MatrixXd SubspaceArithmetic::pseudo_inverse(const MatrixXd& X, double scale) {
  if (X.size() == 0) {
    return MatrixXd::Zero(X.cols(), X.rows());
  }
  const Eigen::JacobiSVD<MatrixXd> svd(X, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const Index r = rank(svd.singularValues(), scale);
  return svd.matrixV().leftCols(r) * svd.singularValues().head(r).cwiseInverse().asDiagonal() *
         svd.matrixU().leftCols(r).transpose();
}

MatrixXd complement(const MatrixXd& basis) {
  const Index n = basis.rows();
  if (basis.cols() == 0) {
    return MatrixXd::Identity(n, n);
  }
  const Eigen::HouseholderQR<MatrixXd> qr(basis);
  const MatrixXd Q = qr.householderQ();
  return Q.rightCols(n - basis.cols());
}

MatrixXd canonical_rows(const MatrixXd& projector, Index dimension) {
  const Index n = projector.rows();
  MatrixXd rows(dimension, n);
  MatrixXd rest = projector;
  for (Index i = 0; i < dimension; ++i) {
    VectorXd row = rest.col(first_largest(rest.colwise().squaredNorm().transpose()));
    // Twice is enough: the second pass removes what rounding left of the first.
    for (int pass = 0; pass < 2; ++pass) {
      row -= rows.topRows(i).transpose() * (rows.topRows(i) * row);
    }
    row.normalize();
    rows.row(i) = row[first_largest(row.cwiseAbs())] < 0.0 ? VectorXd(-row) : row;
    rest -= row * (row.transpose() * rest);
  }
  return rows;
}

}  // namespace faultline

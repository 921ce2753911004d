#include "diagnosis/certify/balance.h"

#include <cmath>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Scales within this factor of each other stay as they are.
constexpr double kSaneSpread = 16.0;
// Each sweep halves what is out of balance at least; scales of 2^±1000 do not occur.
constexpr int kMaxSweeps = 64;

// Norms of row and column i of [A B; C 0] without A's diagonal, B's columns and C's rows scaled to
// A's own size.
struct Sizes {
  double row = 0.0;
  double column = 0.0;
};

Sizes sizes_of(const MatrixXd& A, const MatrixXd& B, const MatrixXd& C, Index i) {
  Sizes sizes;
  for (Index k = 0; k < A.rows(); ++k) {
    if (k != i) {
      sizes.row = std::hypot(sizes.row, A(i, k));
      sizes.column = std::hypot(sizes.column, A(k, i));
    }
  }
  const double rate = A.norm() / std::sqrt(static_cast<double>(A.rows()));
  const double unit = rate > 0.0 ? rate : 1.0;
  for (Index k = 0; k < B.cols(); ++k) {
    const double norm = B.col(k).norm();
    sizes.row = norm > 0.0 ? std::hypot(sizes.row, unit * B(i, k) / norm) : sizes.row;
  }
  for (Index k = 0; k < C.rows(); ++k) {
    const double norm = C.row(k).norm();
    sizes.column = norm > 0.0 ? std::hypot(sizes.column, unit * C(k, i) / norm) : sizes.column;
  }
  return sizes;
}

}  // namespace

double power_of_two(double value) {
  return value > 0.0 && std::isfinite(value) ? std::exp2(std::round(std::log2(value))) : 1.0;
}

VectorXd state_scales(const MatrixXd& A, const MatrixXd& B, const MatrixXd& C) {
  const Index n = A.rows();
  VectorXd scales = VectorXd::Ones(n);
  MatrixXd A_scaled = A;
  MatrixXd B_scaled = B;
  MatrixXd C_scaled = C;
  bool is_changed = true;
  for (int sweep = 0; is_changed && sweep < kMaxSweeps; ++sweep) {
    is_changed = false;
    for (Index i = 0; i < n; ++i) {
      const Sizes sizes = sizes_of(A_scaled, B_scaled, C_scaled, i);
      // A state that nothing moves, or that moves nothing, has no scale by its neighbours: its own
      // rate gives one.
      const double own = std::abs(A_scaled(i, i));
      const double row = sizes.row > 0.0 ? sizes.row : own;
      const double column = sizes.column > 0.0 ? sizes.column : own;
      const bool is_lonely = !(sizes.row > 0.0) || !(sizes.column > 0.0);
      const double factor = row > 0.0 && column > 0.0
                                ? power_of_two(is_lonely ? row / column : std::sqrt(row / column))
                                : 1.0;
      if (factor == 1.0) {
        continue;
      }
      is_changed = true;
      scales[i] *= factor;
      A_scaled.row(i) /= factor;
      B_scaled.row(i) /= factor;
      A_scaled.col(i) *= factor;
      C_scaled.col(i) *= factor;
    }
  }
  const bool is_sane =
      n == 0 || !scales.allFinite() || scales.maxCoeff() <= kSaneSpread * scales.minCoeff();
  return is_sane ? VectorXd::Ones(n) : scales;
}

}  // namespace faultline

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

VectorXd inverse_or_zero(const VectorXd& norms) {
  return norms.unaryExpr([](double norm) { return norm > 0.0 ? 1.0 / norm : 0.0; });
}

}  // namespace

double power_of_two(double value) {
  return value > 0.0 && std::isfinite(value) ? std::exp2(std::round(std::log2(value))) : 1.0;
}

VectorXd state_scales(const MatrixXd& A, const MatrixXd& B, const MatrixXd& C) {
  const Index n = A.rows();
  VectorXd scales = VectorXd::Ones(n);
  MatrixXd coupling = A;  // between different states
  coupling.diagonal().setZero();
  MatrixXd B_scaled = B;
  MatrixXd C_scaled = C;
  bool is_changed = true;
  for (int sweep = 0; is_changed && sweep < kMaxSweeps; ++sweep) {
    is_changed = false;
    // Columns of B and rows of C count as if they had A's own size.
    const double rate = std::hypot(coupling.norm(), A.diagonal().norm());
    const double unit = rate > 0.0 ? rate / std::sqrt(static_cast<double>(n)) : 1.0;
    const VectorXd input_weights = unit * inverse_or_zero(B_scaled.colwise().norm().transpose());
    const VectorXd output_weights = unit * inverse_or_zero(C_scaled.rowwise().norm());
    for (Index i = 0; i < n; ++i) {
      const double moved = std::hypot(
          coupling.row(i).norm(), B_scaled.row(i).transpose().cwiseProduct(input_weights).norm());
      const double moving =
          std::hypot(coupling.col(i).norm(), C_scaled.col(i).cwiseProduct(output_weights).norm());
      // A state that nothing moves, or that moves nothing, has no scale by its neighbours: its own
      // rate gives one.
      const double own = std::abs(A(i, i));
      const bool is_lonely = !(moved > 0.0) || !(moving > 0.0);
      const double row = moved > 0.0 ? moved : own;
      const double column = moving > 0.0 ? moving : own;
      const double factor = row > 0.0 && column > 0.0
                                ? power_of_two(is_lonely ? row / column : std::sqrt(row / column))
                                : 1.0;
      if (factor == 1.0) {
        continue;
      }
      is_changed = true;
      scales[i] *= factor;
      coupling.row(i) /= factor;
      B_scaled.row(i) /= factor;
      coupling.col(i) *= factor;
      C_scaled.col(i) *= factor;
    }
  }
  const bool is_sane =
      n == 0 || !scales.allFinite() || scales.maxCoeff() <= kSaneSpread * scales.minCoeff();
  return is_sane ? VectorXd::Ones(n) : scales;
}

}  // namespace faultline

#include "diagnosis/design/balance.h"

#include <algorithm>
#include <cmath>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kRadixBits = 4;  // powers of 16
// Sweeps over all states; a handful is enough, the rest bounds the work on odd data.
constexpr int kSweeps = 30;
// Units stay within 16^±40: products of two of them and of the data stay finite.
constexpr double kLargestExponent = 40.0;

// The power of 16 nearest to `ratio`; 1 for ratios that say nothing.
double nearest_power(double ratio) {
  if (!(ratio > 0.0) || !std::isfinite(ratio)) {
    return 1.0;
  }
  const double exponent = std::round(std::log2(ratio) / kRadixBits);
  const double bounded = std::clamp(exponent, -kLargestExponent, kLargestExponent);
  return std::ldexp(1.0, kRadixBits * static_cast<int>(bounded));
}

double inverse_norm(double norm) { return norm > 0.0 && std::isfinite(norm) ? 1.0 / norm : 0.0; }

// Weights that give the columns of L and the rows of C length one.
VectorXd column_weights(const MatrixXd& X) {
  return X.colwise().stableNorm().transpose().unaryExpr(&inverse_norm);
}

double without(const VectorXd& values, Index i) {
  VectorXd rest = values;
  rest[i] = 0.0;
  return rest.stableNorm();
}

}  // namespace

MatrixXd Balance::of_state(const MatrixXd& A) const {
  return state.cwiseInverse().asDiagonal() * A * state.asDiagonal();
}

MatrixXd Balance::of_output(const MatrixXd& C) const {
  return output.cwiseInverse().asDiagonal() * C * state.asDiagonal();
}

Balance balance(const MatrixXd& A, const MatrixXd& C, const MatrixXd& L) {
  const Index n = A.rows();
  Balance units{VectorXd::Ones(n), VectorXd::Ones(C.rows())};
  const double size = A.stableNorm();
  if (!std::isfinite(size)) {
    return units;
  }
  // Time has a unit, too: A is measured by its own size.
  MatrixXd A_b = A * (size > 0.0 ? 1.0 / size : 1.0);
  MatrixXd C_b = C;
  MatrixXd L_b = L;
  bool is_changed = true;
  for (int sweep = 0; sweep < kSweeps && is_changed; ++sweep) {
    is_changed = false;
    const VectorXd input_weights = column_weights(L_b);
    const VectorXd output_weights = column_weights(C_b.transpose());
    for (Index i = 0; i < n; ++i) {
      const VectorXd input_row = L_b.row(i).transpose().cwiseProduct(input_weights);
      const VectorXd output_column = C_b.col(i).cwiseProduct(output_weights);
      const double row = std::hypot(without(A_b.row(i), i), input_row.stableNorm());
      const double column = std::hypot(without(A_b.col(i), i), output_column.stableNorm());
      // Column times t, row divided by t: equal at t² = row / column.
      const double t = nearest_power(std::sqrt(row) * std::sqrt(inverse_norm(column)));
      const double total = units.state[i] * t;
      if (t == 1.0 || std::abs(std::log2(total)) > kRadixBits * kLargestExponent) {
        continue;
      }
      units.state[i] = total;
      A_b.row(i) /= t;
      A_b.col(i) *= t;
      L_b.row(i) /= t;
      C_b.col(i) *= t;
      is_changed = true;
    }
  }
  const VectorXd lengths = C_b.rowwise().stableNorm();
  const double longest = lengths.size() == 0 ? 0.0 : lengths.maxCoeff();
  for (Index i = 0; i < lengths.size(); ++i) {
    units.output[i] = nearest_power(lengths[i] * inverse_norm(longest));
  }
  return units;
}

}  // namespace faultline

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

struct System {
  MatrixXd A, C, L;
};

// Sweeps over the states until none changes its unit. With inputs and outputs, A is measured by its
// own size (time has a unit, too), columns of L and rows of C by theirs.
void balance_states(System& system, bool is_with_channels, VectorXd& units) {
  auto& [A, C, L] = system;
  bool is_changed = true;
  for (int sweep = 0; sweep < kSweeps && is_changed; ++sweep) {
    is_changed = false;
    const double size = inverse_norm(A.stableNorm());
    const VectorXd input_weights = column_weights(L);
    const VectorXd output_weights = column_weights(C.transpose());
    for (Index i = 0; i < A.rows(); ++i) {
      double row = size * without(A.row(i), i);
      double column = size * without(A.col(i), i);
      if (is_with_channels) {
        row = std::hypot(row, L.row(i).transpose().cwiseProduct(input_weights).stableNorm());
        column = std::hypot(column, C.col(i).cwiseProduct(output_weights).stableNorm());
      }
      // Column times t, row divided by t: equal at t² = row / column.
      const double t = nearest_power(std::sqrt(row) * std::sqrt(inverse_norm(column)));
      const double unit = units[i] * t;
      if (t == 1.0 || std::abs(std::log2(unit)) > kRadixBits * kLargestExponent) {
        continue;
      }
      units[i] = unit;
      A.row(i) /= t;
      A.col(i) *= t;
      L.row(i) /= t;
      C.col(i) *= t;
      is_changed = true;
    }
  }
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
  if (!A.allFinite() || !C.allFinite() || !L.allFinite()) {
    return units;
  }
  System system{A, C, L};
  // A alone first: beside an A in odd units, inputs and outputs would seem all that counts.
  balance_states(system, false, units.state);
  balance_states(system, true, units.state);
  const VectorXd lengths = system.C.rowwise().stableNorm();
  const double longest = lengths.size() == 0 ? 0.0 : lengths.maxCoeff();
  for (Index i = 0; i < lengths.size(); ++i) {
    units.output[i] = nearest_power(lengths[i] * inverse_norm(longest));
  }
  return units;
}

}  // namespace faultline

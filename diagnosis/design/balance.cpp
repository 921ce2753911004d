#include "diagnosis/design/balance.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/QR>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kRadixBits = 4;  // powers of 16
// Units stay within 16^±40: products of two of them and of the data stay finite.
constexpr double kLargestExponent = 40.0;
// An entry below this part of the largest of its kind, in balanced units, is a rounding error of
// zero: it says nothing about units.
constexpr double kRoundingError = 1e-13;
// How much cheaper the sizes of A, C and of the directions, which are not used, are to change than
// the units of states and outputs, where the least squares leave a choice.
constexpr double kFree = 1e3;

// The four matrices as equations: log2 |entry| + unit[plus] - unit[minus] = size[kind].
struct Entry {
  int kind;
  double log_size;
  Index plus, minus;
};

// Unknowns: units of states, of outputs, of directions; sizes of A and C.
class LogarithmicUnits {
 public:
  LogarithmicUnits(const MatrixXd& A, const MatrixXd& C, const Directions& directions)
      : n_(A.rows()), q_(C.rows()), k_(directions.state.cols()) {
    for (Index i = 0; i < n_; ++i) {
      for (Index j = 0; j < n_; ++j) {
        if (i != j) {
          add(kSizeOfA, A(i, j), j, i);
        }
      }
    }
    for (Index i = 0; i < q_; ++i) {
      for (Index j = 0; j < n_; ++j) {
        add(kSizeOfC, C(i, j), j, n_ + i);
      }
    }
    for (Index j = 0; j < k_; ++j) {
      for (Index i = 0; i < n_; ++i) {
        add(kDirections, directions.state(i, j), n_ + q_ + j, i);
      }
      for (Index i = 0; i < q_; ++i) {
        add(kDirections, directions.output(i, j), n_ + q_ + j, n_ + i);
      }
    }
  }

  // log2 of the units of states, then of outputs.
  VectorXd solve() {
    const VectorXd first = least_squares();
    drop_rounding_errors(first);
    return least_squares().head(n_ + q_);
  }

 private:
  enum Kind { kSizeOfA, kSizeOfC, kDirections };

  void add(Kind kind, double entry, Index plus, Index minus) {
    if (entry != 0.0 && std::isfinite(entry)) {
      entries_.push_back({kind, std::log2(std::abs(entry)), plus, minus});
    }
  }

  [[nodiscard]] Index size_index(int kind) const { return n_ + q_ + k_ + kind; }

  [[nodiscard]] VectorXd least_squares() const {
    const Index count = n_ + q_ + k_ + 2;
    VectorXd cost = VectorXd::Ones(count);
    cost.tail(count - n_ - q_).setConstant(1.0 / kFree);
    MatrixXd normal = MatrixXd::Zero(count, count);
    VectorXd right = VectorXd::Zero(count);
    for (const Entry& entry : entries_) {
      // The equation's row holds +1, -1 and, with a size, -1.
      const bool has_size = entry.kind != kDirections;
      const Index columns[] = {entry.plus, entry.minus, has_size ? size_index(entry.kind) : 0};
      const double factors[] = {1.0 / cost[entry.plus], -1.0 / cost[entry.minus],
                                has_size ? -1.0 / cost[columns[2]] : 0.0};
      for (int a = 0; a < 3; ++a) {
        right[columns[a]] -= factors[a] * entry.log_size;
        for (int b = 0; b < 3; ++b) {
          normal(columns[a], columns[b]) += factors[a] * factors[b];
        }
      }
    }
    const VectorXd scaled = normal.completeOrthogonalDecomposition().solve(right);
    return scaled.cwiseQuotient(cost);
  }

  void drop_rounding_errors(const VectorXd& units) {
    double largest[] = {-INFINITY, -INFINITY, -INFINITY};
    const auto balanced = [&](const Entry& entry) {
      return entry.log_size + units[entry.plus] - units[entry.minus];
    };
    for (const Entry& entry : entries_) {
      largest[entry.kind] = std::max(largest[entry.kind], balanced(entry));
    }
    std::erase_if(entries_, [&](const Entry& entry) {
      return balanced(entry) < largest[entry.kind] + std::log2(kRoundingError);
    });
  }

  Index n_, q_, k_;
  std::vector<Entry> entries_;
};

double nearest_power(double log2_unit) {
  if (!std::isfinite(log2_unit)) {
    return 1.0;
  }
  const double exponent =
      std::clamp(std::round(log2_unit / kRadixBits), -kLargestExponent, kLargestExponent);
  return std::ldexp(1.0, kRadixBits * static_cast<int>(exponent));
}

}  // namespace

MatrixXd Balance::of_state(const MatrixXd& A) const {
  return state.cwiseInverse().asDiagonal() * A * state.asDiagonal();
}

MatrixXd Balance::of_output(const MatrixXd& C) const {
  return output.cwiseInverse().asDiagonal() * C * state.asDiagonal();
}

Directions Balance::of_directions(const Directions& directions) const {
  return {state.cwiseInverse().asDiagonal() * directions.state,
          output.cwiseInverse().asDiagonal() * directions.output};
}

Balance balance(const MatrixXd& A, const MatrixXd& C, const Directions& directions) {
  const VectorXd units = LogarithmicUnits(A, C, directions).solve().unaryExpr(&nearest_power);
  return {units.head(A.rows()), units.tail(C.rows())};
}

}  // namespace faultline

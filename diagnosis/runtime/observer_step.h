#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "diagnosis/bank/bank.h"

namespace faultline {

// What a filter with Lipschitz terms or a course does beyond a linear one. Private to
// diagnosis/runtime.

/// W (φ(s) - c s), s = a_v v + a_y (y - y₀) + a_u (u - u₀), with the numbers side by side.
class NonlinearTerm {
 public:
  explicit NonlinearTerm(const FilterNonlinearity& term);

  /// φ(s) - c s. Sums run over the states, then the outputs, then the inputs, each in order.
  /// @param v the filter's state: v(i) is component i
  /// @param sample y - y₀, u - u₀
  template <class State>
  [[nodiscard]] double excess(const State& v, std::span<const double> sample) const noexcept {
    double s = 0.0;
    for (std::size_t i = 0; i < order(); ++i) s += a_v_[i] * v(i);
    for (std::size_t c = 0; c < sample.size(); ++c) s += a_channels_[c] * sample[c];
    return evaluate(function_, s) - center_ * s;
  }
  [[nodiscard]] std::size_t order() const noexcept { return a_v_.size(); }
  [[nodiscard]] std::span<const double> W() const noexcept { return W_; }

 private:
  NonlinearFunction function_;
  double center_;
  std::vector<double> W_, a_v_, a_channels_;
};

/// The thresholds of one filter over the samples, and its evaluation signal against them.
class CourseEvaluation {
 public:
  /// Precondition: filter.course is there, with at least one sample.
  explicit CourseEvaluation(const ResidualFilter& filter);

  /// The threshold of the evaluation signal at sample k; the last one holds for all later k.
  [[nodiscard]] double threshold(std::size_t k) const noexcept;
  /// r̄(k).
  [[nodiscard]] std::span<const double> rows(std::size_t k) const noexcept;
  /// ‖Ω r‖₂, or max_i |r_i| / r̄_i(k); NaN if there is one in r.
  [[nodiscard]] double evaluate(std::span<const double> r, std::size_t k) const noexcept;

 private:
  [[nodiscard]] double weighted_norm(std::span<const double> r) const noexcept;
  [[nodiscard]] double largest_share(std::span<const double> r,
                                     std::span<const double> bound) const noexcept;

  Evaluation evaluation_;
  std::size_t row_count_;
  std::vector<double> weight_;     // Ω, row by row
  std::vector<double> norm_;       // J(k)
  std::vector<double> component_;  // r̄(k), sample by sample
};

}  // namespace faultline

#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// Runs all filters of a bank, one step per sample, k = 0 the first after construction or reset():
///
///   r_k   = M v_k - H (y_k - y₀) + K (u_k - u₀)
///   v_k+1 = F v_k - E (y_k - y₀) + G (u_k - u₀) + Σ W_i (φ_i(s_i) - c_i s_i)
///   s_i   = a_v v_k + a_y (y_k - y₀) + a_u (u_k - u₀)
///
/// Evaluation signal and threshold of a filter (FilterNonlinearity, ThresholdCourse):
///
/// | filter | evaluation | threshold |
/// |---|---|---|
/// | without a course | ‖r_k‖₂ | τ |
/// | Evaluation::kNorm | ‖Ω r_k‖₂ | J(k) |
/// | Evaluation::kComponent | max_i \|r_i\| / r̄_i(k) | 1 |
/// | with a SequentialTest | its statistic | h |
///
/// Real-time: `step` and `reset` neither allocate nor throw. Sums have a fixed order: equal inputs
/// give equal bits in every build; where there is a φ, with the same sin, cos, tanh and atan. Use
/// from one thread.
class ResidualBank {
 public:
  explicit ResidualBank(const Bank& bank);
  ~ResidualBank();
  ResidualBank(ResidualBank&&) noexcept;
  ResidualBank& operator=(ResidualBank&&) noexcept;

  /// Takes sample (y_k, u_k); sizes q and m. Afterwards residual(), evaluation() and the thresholds
  /// are those of k. Precondition: finite values; a NaN stays in every filter until reset().
  void step(std::span<const double> y, std::span<const double> u) noexcept;
  /// Back to v = 0 and k = 0.
  void reset() noexcept;

  /// Sequential tests begin anew where the residual is contaminated (Evaluator::contaminated()):
  /// what a bad sample left must not add up. Once per sample, after step().
  void restart_tests(std::span<const std::uint8_t> is_contaminated) noexcept;

  /// r_k of all filters, stacked; Bank::residual_rows() values. Valid until the next call.
  [[nodiscard]] std::span<const double> residual() const noexcept;
  /// Evaluation signal per filter. NaN if the residual has one.
  [[nodiscard]] std::span<const double> evaluation() const noexcept;
  /// Threshold of the evaluation signal, per filter, at this sample; before the first one at k = 0.
  [[nodiscard]] std::span<const double> thresholds() const noexcept;
  /// Per row of residual(): |r_i| is at most this r̄_i(k) without a fault; kNoThreshold: the filter
  /// has no course.
  [[nodiscard]] std::span<const double> row_thresholds() const noexcept;
  static constexpr double kNoThreshold = -1.0;
  [[nodiscard]] std::size_t filter_count() const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline

#pragma once

#include <memory>
#include <span>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// Runs all filters of a bank, one step per sample:
///
///   r_k   = M v_k - H (y_k - y₀) + K (u_k - u₀)
///   v_k+1 = F v_k - E (y_k - y₀) + G (u_k - u₀)
///
/// Real-time: `step` and `reset` neither allocate nor throw. Sums have a fixed order: equal inputs
/// give equal bits in every build. Use from one thread.
class ResidualBank {
 public:
  explicit ResidualBank(const Bank& bank);
  ~ResidualBank();
  ResidualBank(ResidualBank&&) noexcept;
  ResidualBank& operator=(ResidualBank&&) noexcept;

  /// Takes sample (y_k, u_k); sizes q and m. Afterwards residual() and evaluation() are those of k.
  /// Precondition: finite values; a NaN stays in every filter until reset().
  void step(std::span<const double> y, std::span<const double> u) noexcept;
  /// Back to v = 0.
  void reset() noexcept;

  /// r_k of all filters, stacked; Bank::residual_rows() values. Valid until the next call.
  [[nodiscard]] std::span<const double> residual() const noexcept;
  /// Evaluation signal per filter: |r| for one row, ‖r‖₂ for several.
  [[nodiscard]] std::span<const double> evaluation() const noexcept;
  [[nodiscard]] std::size_t filter_count() const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline

#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// Whether there is an estimate, and why not.
enum class EstimateStatus : std::uint8_t {
  kValid,
  kTooFewSamples,  ///< the window is not full, or reaches back before the last crossing
  kTransientOnly,  ///< a fault of the set is seen only in transients: a constant one leaves nothing
  kDependent,      ///< faults of the set leave the same traces: only a combination can be estimated
  kTooLarge,       ///< bank and window are beyond what an estimate may cost
  kSettling,       ///< the filter that estimates the fault has not settled since the last crossing
};
/// What to tell a reader: "" for kValid, else a reason in words.
[[nodiscard]] std::string_view estimate_status_text(EstimateStatus status) noexcept;

/// Estimated magnitudes of a fault set.
struct MagnitudeEstimate {
  static constexpr double kUnknown = -1.0;
  EstimateStatus status = EstimateStatus::kTooFewSamples;
  std::vector<std::size_t> faults;  ///< indices into Bank::fault_names
  std::vector<double> value;        ///< per fault, in its unit; empty unless valid
  std::vector<double> deviation;    ///< per fault: one standard deviation, in its unit; kUnknown if
                                    ///< the window leaves nothing to tell it from
  std::vector<double> bound{};      ///< per fault: |value - truth| is at most this, in its unit;
                                    ///< kUnknown: nothing of the kind was proved
};

/// Least squares estimate of the magnitudes m of a fault set from the last `window` residual
/// vectors, with all faults of the set constant over them and no other acting.
///
/// Per filter, over the window's samples t = 0 .. N-1 (internal form):
///
///   r_t = M F^t e_0 - Σ_j s_j(t) m_j + (errors),   s_j(t) = J_j + Σ_{i<t} M F^i L_j
///
/// e_0, all that happened before the window, is unknown: with an orthonormal basis Q of the range
/// of O = [M; MF; ..; MF^(N-1)] and Π = I - Q Qᵀ what is left is Π r = -Π S m, hence
///
///   Γ = Σ SᵀΠS,   m = -Γ⁻¹ Σ SᵀΠ r   (sums over the filters; rows and columns of the set).
///
/// Deviation: errors n of the outputs, white, of equal variance σ² on all of them, reach the window
/// as T n (T_0 = -H, T_t = -M F^(t-1) E; those before it are in e_0). With Ψ = Σ SᵀΠT (Σ SᵀΠT)ᵀ
///
///   cov m = σ² Γ⁻¹ Ψ Γ⁻¹,   σ² = Σ‖Π(r + S m)‖² / (Σ‖ΠT‖² - tr Γ⁻¹Ψ).
///
/// An output that stands still between two steps of its signal errs by a constant, which the fit
/// takes for a fault and σ² does not know of. So a constant error of each output, uniform over one
/// step of its resolution, is added to the covariance.
///
/// Nothing here allocates after construction. `push` costs one copy of the residuals; `estimate`
/// one pass over Σ rows·window·(d + faults) numbers: keep it off the diagnosis thread. Use from one
/// thread.
class MagnitudeEstimator {
 public:
  /// Largest number of doubles it holds: 64 MiB. 120 filters of order 17 with 9 rows and a window
  /// of 50 need 1.7e6.
  static constexpr double kMaxDoubles = 8388608.0;
  /// Largest number of multiplications its construction may take: a fifth of a second. The same
  /// bank needs 0.25e9.
  static constexpr double kMaxWork = 2e9;

  /// Beyond these bounds it holds nothing and answers kTooLarge.
  /// @param output_resolution per output, in its unit, the step between values it can have; 0 or
  /// an empty list: as fine as one likes
  explicit MagnitudeEstimator(const Bank& bank, std::span<const double> output_resolution = {});
  ~MagnitudeEstimator();
  MagnitudeEstimator(MagnitudeEstimator&&) noexcept;
  MagnitudeEstimator& operator=(MagnitudeEstimator&&) noexcept;

  /// Takes the residuals of a good sample (ResidualBank::residual()). A cycle that does not follow
  /// the one before, or a residual that is not finite, starts the window again.
  void push(std::uint32_t cycle, std::span<const double> residual) noexcept;
  /// Forgets all samples: what comes next has another past. A bad sample needs no more than this.
  void restart() noexcept;

  /// True if the window is full and lies wholly at or after `cycle`; what estimate() asks first.
  [[nodiscard]] bool is_window_behind(std::int64_t cycle) const noexcept;
  /// Estimates the set `faults`, distinct indices, at most the bank's `concurrent`.
  /// @param last_crossing_cycle Onset::last_cycle: the window must lie behind it.
  /// @return valid until the next call.
  const MagnitudeEstimate& estimate(std::span<const std::size_t> faults,
                                    std::int64_t last_crossing_cycle) noexcept;

  /// How many samples after its onset the last estimate, a step, takes filter `filter` above its
  /// threshold; nothing if it does not within the window, or there is no estimate.
  [[nodiscard]] std::optional<std::uint32_t> response_delay(std::size_t filter) noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline

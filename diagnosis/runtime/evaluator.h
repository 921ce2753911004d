#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// Turns evaluation signals into fired residuals, with dwell and contamination.
///
/// A residual fires when its evaluation is above its threshold (strictly) for `dwell` samples in a
/// row, and clears when it is not for `dwell` samples in a row. A bad sample contaminates a
/// residual that uses an affected channel for its `forget_samples`, that sample included; a
/// contaminated residual neither fires nor clears. Per sample: contaminate() if it is bad, then
/// step(), then the questions. An evaluation or a threshold that is NaN counts as above.
///
/// A fired residual with `transient_samples` > 0 is persistent once it has been fired for more
/// samples than that in a row: no constant fault that it sees only in transients does this.
/// Contamination begins the row again, because a bad sample makes a residual fire, too.
///
/// Real-time: allocates only on construction.
class Evaluator {
 public:
  explicit Evaluator(const Bank& bank);

  /// Start-up, or everything forgotten: contaminates the residuals that need time to forget the
  /// unknown state. Those with a course do not: its thresholds hold from the first sample on.
  void contaminate_start() noexcept;
  /// A bad sample of which no channel is known to be good: contaminates all residuals.
  void contaminate_all() noexcept;
  /// Contaminates the residuals that use an output with y_is_fresh == 0 or an input with
  /// u_is_fresh == 0.
  void contaminate(std::span<const std::uint8_t> y_is_fresh,
                   std::span<const std::uint8_t> u_is_fresh) noexcept;
  /// Takes the evaluation signals of one sample and their thresholds (ResidualBank::evaluation(),
  /// thresholds()).
  void step(std::span<const double> evaluation, std::span<const double> thresholds) noexcept;
  /// Nothing fired, nothing contaminated.
  void reset() noexcept;

  [[nodiscard]] std::span<const std::uint8_t> fired() const noexcept { return fired_; }
  /// Fired residuals as bits, 64 per word.
  [[nodiscard]] std::span<const std::uint64_t> signature() const noexcept { return signature_; }
  /// Persistent residuals, likewise; each has fired.
  [[nodiscard]] std::span<const std::uint64_t> persistent() const noexcept { return persistent_; }
  /// How many samples ago the run of samples began that made residual i fire, or clear, last:
  /// `dwell` - 1 when it has just done so. Meaningless before its first crossing.
  [[nodiscard]] std::uint64_t crossing_age(std::size_t i) const noexcept {
    return sample_count_ - crossed_at_[i];
  }
  /// Which residuals of the last sample were contaminated.
  [[nodiscard]] std::span<const std::uint8_t> contaminated() const noexcept {
    return is_contaminated_;
  }
  /// True if a residual of the last sample was contaminated: its signature says nothing.
  [[nodiscard]] bool is_any_contaminated() const noexcept { return contaminated_count_ > 0; }

 private:
  void contaminate_residual(std::size_t i) noexcept;
  void take(std::size_t i, bool is_above) noexcept;
  void set_fired_for(std::size_t i, std::uint32_t samples) noexcept;

  std::uint32_t dwell_;
  std::vector<std::uint32_t> forget_samples_;
  std::vector<std::uint32_t> transient_samples_;
  std::vector<std::uint8_t> has_course_;
  std::vector<std::vector<std::uint8_t>> uses_y_, uses_u_;  // per filter, per channel
  std::vector<std::uint32_t> contaminated_for_;
  std::vector<std::uint8_t> is_contaminated_;
  std::vector<std::uint32_t> run_length_;
  std::vector<std::uint8_t> fired_;
  std::vector<std::uint32_t> fired_for_;  // samples in a row; at most transient_samples + 1
  std::vector<std::uint64_t> signature_;
  std::vector<std::uint64_t> persistent_;
  std::vector<std::uint64_t> crossed_at_;  // value of sample_count_ at the crossing's first sample
  std::uint64_t sample_count_ = 0;
  std::size_t contaminated_count_ = 0;
};

}  // namespace faultline

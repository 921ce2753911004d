#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace faultline {

/// A signal over the cycles of a run, kept as the smallest and the largest value of each stretch of
/// 2^s cycles: bucket i covers the cycles [origin + i·2^s, origin + (i + 1)·2^s). No peak is lost,
/// however long the run is: extremes are rounded outwards to single precision, never inwards.
/// s begins at 0 (every sample kept) and grows by one whenever the buckets run out.
/// Memory: at most 8 bytes times kMostBuckets. Adding takes O(1) amortised.
class EnvelopeSeries {
 public:
  static constexpr std::size_t kMostBuckets = std::size_t{1} << 16;

  /// @param origin first cycle of bucket 0: the run's first, which all its series share.
  explicit EnvelopeSeries(std::int64_t origin) noexcept : origin_(origin), last_(origin) {}

  /// `cycle` has `value`; one that is no number leaves nothing. A cycle before the last one is
  /// counted into that.
  void add(std::int64_t cycle, double value);

  /// Merges buckets until each covers 2^shift cycles. Does nothing if they cover more already.
  void widen_to(int shift);

  [[nodiscard]] bool is_empty() const noexcept { return low_.empty(); }
  [[nodiscard]] std::int64_t origin() const noexcept { return origin_; }
  [[nodiscard]] int shift() const noexcept { return shift_; }
  /// Per bucket; NaN where no sample fell into it.
  [[nodiscard]] const std::vector<float>& low() const noexcept { return low_; }
  [[nodiscard]] const std::vector<float>& high() const noexcept { return high_; }
  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }
  /// Of all values, exact. @pre not empty
  [[nodiscard]] double smallest() const noexcept { return smallest_; }
  [[nodiscard]] double largest() const noexcept { return largest_; }
  /// The cycle of the value that is largest in magnitude. @pre not empty
  [[nodiscard]] std::int64_t peak_cycle() const noexcept { return peak_cycle_; }
  /// All values are the same one, in every bucket from the first to the last.
  [[nodiscard]] bool is_constant() const noexcept;

 private:
  void halve();

  std::vector<float> low_, high_;
  std::int64_t origin_;
  std::int64_t last_;  ///< cycle
  int shift_ = 0;
  std::uint64_t count_ = 0;
  double smallest_ = 0.0, largest_ = 0.0;
  std::int64_t peak_cycle_ = 0;
};

}  // namespace faultline

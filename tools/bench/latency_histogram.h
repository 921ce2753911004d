#pragma once

#include <array>
#include <bit>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace faultline {

/// Durations counted in buckets of equal relative width, as HdrHistogram does: 16 per octave, so a
/// bucket is at most 1/16 of its value wide; from 0 to 2^36 ns (69 s), longer ones in the last.
/// Memory: 4.7 kB, fixed. Real-time: recording is a few instructions and never allocates.
class LatencyHistogram {
 public:
  using Nanoseconds = std::chrono::nanoseconds;

  struct Bucket {
    Nanoseconds upper;  ///< inclusive upper edge
    std::uint64_t count = 0;
  };

  /// A negative one (a clock was set back) counts as zero.
  void record(Nanoseconds value) noexcept { record(value, 1); }

  /// Records `value`, and for `missed` others that were due before it, one every `interval`, and
  /// got no value of their own, how long they waited for this one: value + interval,
  /// value + 2·interval, .., value + missed·interval. They count as filled in (correction for
  /// coordinated omission; which stage needs it: docs/decisions/0012).
  void record_missed(Nanoseconds value, Nanoseconds interval, std::uint64_t missed) noexcept;

  /// What `buckets`, `min`, `max` and `corrected` of a histogram tell of it. From outside: a
  /// negative duration counts as zero, and the extremes are brought in order.
  [[nodiscard]] static LatencyHistogram restore(std::span<const Bucket> buckets, Nanoseconds min,
                                                Nanoseconds max, std::uint64_t corrected) noexcept;

  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }
  /// Of these, the values that were filled in.
  [[nodiscard]] std::uint64_t corrected() const noexcept { return corrected_; }
  /// Exact; 0 if there is none.
  [[nodiscard]] Nanoseconds min() const noexcept { return Nanoseconds(count_ > 0 ? min_ns_ : 0); }
  [[nodiscard]] Nanoseconds max() const noexcept { return Nanoseconds(max_ns_); }

  /// The value that `percent` % do not exceed, interpolated within its bucket; 0 if there is none.
  [[nodiscard]] Nanoseconds percentile(double percent) const noexcept;

  /// The buckets that hold anything, in order.
  [[nodiscard]] std::vector<Bucket> buckets() const;

 private:
  static constexpr int kSubBits = 4;
  static constexpr int kOctaves = 36;
  static constexpr std::size_t kSubCount = std::size_t{1} << kSubBits;
  static constexpr std::size_t kBucketCount = kSubCount * (kOctaves - kSubBits + 1);

  /// Of very many values to fill in every n-th is recorded with the weight n: a bounded time.
  static constexpr std::int64_t kMostSteps = 1024;

  void record(Nanoseconds value, std::uint64_t count) noexcept;
  [[nodiscard]] static std::size_t bucket_of(std::uint64_t ns) noexcept;
  /// Smallest value of the bucket behind `bucket`.
  [[nodiscard]] static std::uint64_t end_of(std::size_t bucket) noexcept;

  std::array<std::uint64_t, kBucketCount> counts_{};
  std::uint64_t count_ = 0, corrected_ = 0;
  std::int64_t min_ns_ = 0, max_ns_ = 0;
};

/// Latencies of one stage on the way from frame to diagnosis.
struct StageLatency {
  std::string stage;
  LatencyHistogram histogram{};
  std::uint32_t cycles_per_value = 1;  ///< measured in one of so many cycles
};

}  // namespace faultline

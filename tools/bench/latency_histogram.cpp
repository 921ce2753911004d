#include "tools/bench/latency_histogram.h"

#include <algorithm>
#include <cmath>

namespace faultline {

// Values below 2^kSubBits have a bucket each; from there on each octave has kSubCount.
std::size_t LatencyHistogram::bucket_of(std::uint64_t ns) noexcept {
  if (ns < kSubCount) return static_cast<std::size_t>(ns);
  const int octave = static_cast<int>(std::bit_width(ns)) - 1;  // >= kSubBits
  const int shift = octave - kSubBits;
  const std::size_t sub = static_cast<std::size_t>(ns >> shift) - kSubCount;
  const std::size_t bucket = kSubCount * static_cast<std::size_t>(shift + 1) + sub;
  return std::min(bucket, kBucketCount - 1);
}

std::uint64_t LatencyHistogram::end_of(std::size_t bucket) noexcept {
  if (bucket < kSubCount) return bucket + 1;
  const std::size_t shift = bucket / kSubCount - 1;
  return (kSubCount + bucket % kSubCount + 1) << shift;
}

void LatencyHistogram::record(Nanoseconds value, std::uint64_t count) noexcept {
  const std::int64_t ns = std::max<std::int64_t>(value.count(), 0);
  counts_[bucket_of(static_cast<std::uint64_t>(ns))] += count;
  min_ns_ = count_ == 0 ? ns : std::min(min_ns_, ns);
  max_ns_ = std::max(max_ns_, ns);
  count_ += count;
}

void LatencyHistogram::record_missed(Nanoseconds value, Nanoseconds interval,
                                     std::uint64_t missed) noexcept {
  record(value);
  const std::uint64_t weight = 1 + missed / kMostSteps;
  // From the longest down: it is recorded whatever the weight.
  for (std::uint64_t left = missed; left > 0;) {
    const std::uint64_t count = std::min(weight, left);
    record(value + static_cast<std::int64_t>(left) * interval, count);
    left -= count;
  }
  corrected_ += missed;
}

LatencyHistogram LatencyHistogram::restore(std::span<const Bucket> buckets, Nanoseconds min,
                                           Nanoseconds max, std::uint64_t corrected) noexcept {
  LatencyHistogram histogram;
  for (const Bucket& bucket : buckets) histogram.record(bucket.upper, bucket.count);
  if (histogram.count_ == 0) return histogram;
  histogram.min_ns_ = std::max<std::int64_t>(min.count(), 0);
  histogram.max_ns_ = std::max(max.count(), histogram.min_ns_);
  histogram.corrected_ = corrected;
  return histogram;
}

LatencyHistogram::Nanoseconds LatencyHistogram::percentile(double percent) const noexcept {
  if (count_ == 0) return Nanoseconds::zero();
  const double rank = std::clamp(percent, 0.0, 100.0) / 100.0 * static_cast<double>(count_);
  double below = 0.0;
  for (std::size_t i = 0; i < kBucketCount; ++i) {
    const auto here = static_cast<double>(counts_[i]);
    if (here == 0.0 || below + here < rank) {
      below += here;
      continue;
    }
    const auto begin = static_cast<double>(i == 0 ? 0 : end_of(i - 1));
    const auto end = static_cast<double>(end_of(i) - 1);
    const double value = begin + (end - begin) * std::max(rank - below, 0.0) / here;
    return Nanoseconds(std::clamp(std::llround(value), static_cast<long long>(min_ns_),
                                  static_cast<long long>(max_ns_)));
  }
  return max();
}

std::vector<LatencyHistogram::Bucket> LatencyHistogram::buckets() const {
  std::vector<Bucket> filled;
  for (std::size_t i = 0; i < kBucketCount; ++i) {
    if (counts_[i] == 0) continue;
    // The last one holds everything longer, too.
    const std::int64_t upper =
        i + 1 == kBucketCount ? max_ns_ : static_cast<std::int64_t>(end_of(i) - 1);
    filled.push_back({Nanoseconds(upper), counts_[i]});
  }
  return filled;
}

}  // namespace faultline

#include "tools/bench/latency_histogram.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;
using std::chrono::nanoseconds;

/// A bucket is at most 1/16 of its value wide.
constexpr double kBucketWidth = 1.0 / 16.0;

TEST(LatencyHistogram, GivesPercentilesWithinOneBucketOfTheSortedValues) {
  std::mt19937_64 random(7);
  std::lognormal_distribution<double> durations_ns(10.0, 3.0);  // from below 1 µs to seconds
  for (const std::size_t count : {std::size_t{1}, std::size_t{10}, std::size_t{20000}}) {
    LatencyHistogram histogram;
    std::vector<std::int64_t> values;
    for (std::size_t i = 0; i < count; ++i) {
      values.push_back(std::llround(durations_ns(random)));
      histogram.record(nanoseconds(values.back()));
    }
    std::sort(values.begin(), values.end());
    EXPECT_EQ(histogram.count(), count);
    EXPECT_EQ(histogram.min().count(), values.front());
    EXPECT_EQ(histogram.max().count(), values.back());
    for (const double percent : {0.0, 1.0, 50.0, 90.0, 99.0, 99.9, 100.0}) {
      const auto rank = std::ceil(percent / 100.0 * static_cast<double>(count));
      const auto exact =
          static_cast<double>(values[static_cast<std::size_t>(std::max(rank, 1.0)) - 1]);
      const auto found = static_cast<double>(histogram.percentile(percent).count());
      EXPECT_NEAR(found, exact, std::max(1.0, kBucketWidth * exact))
          << percent << " % of " << count;
    }
  }
}

TEST(LatencyHistogram, CountsInBucketsThatAddUp) {
  LatencyHistogram histogram;
  for (int i = 0; i < 5; ++i) histogram.record(3ns);
  histogram.record(1000ns);
  histogram.record(-4ns);  // a clock was set back
  histogram.record(200s);  // beyond the last bucket
  std::uint64_t total = 0;
  nanoseconds last = -1ns;
  for (const LatencyHistogram::Bucket& bucket : histogram.buckets()) {
    EXPECT_GT(bucket.upper, last);
    last = bucket.upper;
    total += bucket.count;
  }
  EXPECT_EQ(total, 8U);
  EXPECT_EQ(histogram.min(), 0ns);
  EXPECT_EQ(histogram.max(), 200s);
  EXPECT_EQ(last, 200s);
  EXPECT_EQ(histogram.percentile(60.0), 3ns);
}

TEST(LatencyHistogram, FillsInThoseThatWaitedForTheNext) {
  LatencyHistogram histogram;
  histogram.record_missed(500us, 1ms, 0);
  EXPECT_EQ(histogram.corrected(), 0U);
  histogram.record_missed(500us, 1ms, 3);  // 0.5 ms, and 1.5, 2.5, 3.5 ms
  EXPECT_EQ(histogram.count(), 5U);
  EXPECT_EQ(histogram.corrected(), 3U);
  EXPECT_EQ(histogram.min(), 500us);
  EXPECT_EQ(histogram.max(), 3500us);
  EXPECT_NEAR(static_cast<double>(histogram.percentile(60.0).count()), 1.5e6, kBucketWidth * 1.5e6);
}

TEST(LatencyHistogram, FillsInAVeryLongStallInAFewSteps) {
  // A year of 1 ms periods one by one would take minutes.
  LatencyHistogram missed;
  missed.record_missed(1us, 1ms, 31'536'000'000U);
  EXPECT_EQ(missed.corrected(), 31'536'000'000U);
  EXPECT_EQ(missed.count(), 31'536'000'001U);
  EXPECT_EQ(missed.max(), 1us + std::chrono::hours(24 * 365));
}

TEST(LatencyHistogram, IsRestoredFromItsBuckets) {
  std::mt19937_64 random(11);
  std::uniform_int_distribution<std::int64_t> values(0, 10'000'000);
  LatencyHistogram original;
  for (int i = 0; i < 1000; ++i) {
    const nanoseconds value(values(random));
    const auto missed = static_cast<std::uint64_t>(i % 4);
    original.record_missed(value, 4ms, missed);
  }
  const LatencyHistogram restored = LatencyHistogram::restore(original.buckets(), original.min(),
                                                              original.max(), original.corrected());
  EXPECT_EQ(restored.count(), original.count());
  EXPECT_EQ(restored.corrected(), original.corrected());
  EXPECT_EQ(restored.min(), original.min());
  EXPECT_EQ(restored.max(), original.max());
  EXPECT_EQ(restored.percentile(99.0), original.percentile(99.0));
}

TEST(LatencyHistogram, TakesNonsenseFromOutside) {
  const std::vector<LatencyHistogram::Bucket> buckets{
      {-5ns, 2}, {10ns, 0}, {nanoseconds::max(), 1}};
  const auto histogram = LatencyHistogram::restore(buckets, 50ns, -7ns, 9);
  EXPECT_EQ(histogram.count(), 3U);
  EXPECT_EQ(histogram.min(), 50ns);
  EXPECT_EQ(histogram.max(), 50ns);
  EXPECT_EQ(histogram.percentile(99.0), 50ns);
  EXPECT_EQ(LatencyHistogram::restore({}, 5ns, 7ns, 9).count(), 0U);
}

TEST(LatencyHistogram, DoesNotAllocate) {
  LatencyHistogram histogram;
  const AllocationGuard guard;
  for (int i = 0; i < 1000; ++i) {
    histogram.record(nanoseconds(i * 1000));
    histogram.record_missed(nanoseconds(i), 1ms, static_cast<std::uint64_t>(i));
  }
  const std::uint64_t calls = guard.heap_calls();
  EXPECT_EQ(calls, 0U);
}

}  // namespace
}  // namespace faultline

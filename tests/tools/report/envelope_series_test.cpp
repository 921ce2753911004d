#include "tools/report/envelope_series.h"

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace faultline {
namespace {

TEST(EnvelopeSeries, KeepsEverySampleOfAShortRun) {
  EnvelopeSeries series(5);
  for (int k = 0; k < 100; ++k) series.add(5 + k, 0.1 * k);
  ASSERT_EQ(series.shift(), 0);
  ASSERT_EQ(series.high().size(), 100U);
  for (std::size_t k = 0; k < 100; ++k) {
    EXPECT_NEAR(series.high()[k], 0.1 * static_cast<double>(k), 1e-6);
  }
}

TEST(EnvelopeSeries, NeverHidesAPeak) {
  // A peak of one sample anywhere in a million: found in the bucket that its cycle belongs to, and
  // no lower than it is.
  constexpr std::int64_t kCycles = 1'000'000;
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 5; ++trial) {
    const auto peak_at = static_cast<std::int64_t>(random() % kCycles);
    const double peak = 1.0 + 1e-9 * static_cast<double>(random() % 1000);
    EnvelopeSeries series(0);
    for (std::int64_t k = 0; k < kCycles; ++k) {
      series.add(k, k == peak_at ? peak : 0.01 * std::sin(static_cast<double>(k)));
    }
    series.widen_to(series.shift() + trial);
    ASSERT_LE(series.high().size(), EnvelopeSeries::kMostBuckets);
    const auto bucket = static_cast<std::size_t>(peak_at >> series.shift());
    EXPECT_GE(static_cast<double>(series.high()[bucket]), peak) << peak_at;
    EXPECT_LT(static_cast<double>(series.high()[bucket]), peak + 1e-6);
    EXPECT_EQ(series.largest(), peak);
    EXPECT_EQ(series.peak_cycle(), peak_at);
  }
}

TEST(EnvelopeSeries, HoldsTheExtremesOfEachBucket) {
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  std::vector<double> values(300'000);
  EnvelopeSeries series(0);
  for (std::size_t k = 0; k < values.size(); ++k) {
    values[k] = normal(random);
    series.add(static_cast<std::int64_t>(k), values[k]);
  }
  const std::size_t width = std::size_t{1} << series.shift();
  for (std::size_t i = 0; i < series.low().size(); ++i) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (std::size_t k = i * width; k < std::min((i + 1) * width, values.size()); ++k) {
      low = std::min(low, values[k]);
      high = std::max(high, values[k]);
    }
    ASSERT_LE(static_cast<double>(series.low()[i]), low);
    ASSERT_GE(static_cast<double>(series.high()[i]), high);
    ASSERT_NEAR(series.low()[i], low, 1e-6);
    ASSERT_NEAR(series.high()[i], high, 1e-6);
  }
}

TEST(EnvelopeSeries, LeavesGapsWhereThereAreNoSamples) {
  EnvelopeSeries series(0);
  series.add(0, 1.0);
  series.add(1, std::nan(""));
  series.add(3, 2.0);
  ASSERT_EQ(series.low().size(), 4U);
  EXPECT_TRUE(std::isnan(series.low()[1]));
  EXPECT_TRUE(std::isnan(series.low()[2]));
  EXPECT_EQ(series.count(), 2U);
  EXPECT_FALSE(series.is_constant());
}

TEST(EnvelopeSeries, BearsCyclesThatNoRunHas) {
  EnvelopeSeries series(0);
  series.add(std::numeric_limits<std::int64_t>::max(), 7.0);
  series.add(3, -7.0);  // before the last one
  EXPECT_LE(series.low().size(), EnvelopeSeries::kMostBuckets);
  EXPECT_EQ(series.low().back(), -7.0F);
  EXPECT_EQ(series.high().back(), 7.0F);
}

TEST(EnvelopeSeries, IsConstantOnlyIfItIsSoThroughout) {
  EnvelopeSeries series(0);
  for (int k = 0; k < 10; ++k) series.add(k, 0.05);
  EXPECT_TRUE(series.is_constant());
  series.add(10, 0.0500000001);
  EXPECT_FALSE(series.is_constant());
}

}  // namespace
}  // namespace faultline

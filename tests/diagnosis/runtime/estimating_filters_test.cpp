#include "diagnosis/runtime/estimating_filters.h"

#include <array>
#include <limits>

#include <gtest/gtest.h>

#include "tests/diagnosis/observer_bank.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

constexpr std::array<std::size_t, 1> kU = {0}, kY1 = {1};
constexpr std::array<std::size_t, 2> kBoth = {0, 1};

using Fired = std::array<std::uint8_t, 2>;
using Rows = std::array<double, 3>;

/// Two observers with dwell 2, of which the second estimates y1 within 0.015 after 8 samples.
class EstimatingFiltersTest : public testing::Test {
 protected:
  /// Samples up to cycle `last`, with f̂ = 0.2.
  void push_to(std::uint32_t last, const Fired& fired) {
    for (; cycle_ <= last; ++cycle_) filters_.push(cycle_, fired, Rows{1.0, 2.0, 0.2});
  }

  EstimatingFilters filters_{observer_bank()};
  std::uint32_t cycle_ = 0;
};

TEST_F(EstimatingFiltersTest, EstimateASingleFaultThatAFilterEstimates) {
  EXPECT_TRUE(filters_.can_estimate(kY1));
  EXPECT_FALSE(filters_.can_estimate(kU));
  EXPECT_FALSE(filters_.can_estimate(kBoth));
  EXPECT_FALSE(filters_.can_estimate({}));
}

TEST_F(EstimatingFiltersTest, GiveTheResidualWithItsBound) {
  push_to(30, {0, 1});
  const MagnitudeEstimate& estimate = filters_.estimate(kY1);
  EXPECT_EQ(estimate.status, EstimateStatus::kValid);
  EXPECT_EQ(estimate.faults, (std::vector<std::size_t>{1}));
  EXPECT_EQ(estimate.value, std::vector{0.2});
  EXPECT_EQ(estimate.deviation, std::vector{MagnitudeEstimate::kUnknown});
  EXPECT_EQ(estimate.bound, std::vector{0.015});
}

TEST_F(EstimatingFiltersTest, SettleFromTheLastCrossingOfAnyFilter) {
  push_to(29, {0, 1});
  push_to(49, {1, 1});  // fired with sample 30: above since 29
  EXPECT_TRUE(filters_.is_settled(kY1));
  push_to(50, {0, 1});  // cleared: below since 49
  for (std::uint32_t k = 50; k < 57; ++k) {
    push_to(k, {0, 1});
    EXPECT_FALSE(filters_.is_settled(kY1)) << k;
    const MagnitudeEstimate& estimate = filters_.estimate(kY1);
    EXPECT_EQ(estimate.status, EstimateStatus::kSettling);
    EXPECT_TRUE(estimate.value.empty() && estimate.bound.empty());
  }
  push_to(57, {0, 1});
  EXPECT_TRUE(filters_.is_settled(kY1));
  EXPECT_EQ(estimate_status_text(EstimateStatus::kSettling), "settling");
}

TEST_F(EstimatingFiltersTest, SettleAgainAfterABadSampleOrAGap) {
  push_to(29, {0, 1});
  filters_.restart();
  ++cycle_;  // 30 was bad
  push_to(37, {0, 1});
  EXPECT_FALSE(filters_.is_settled(kY1));
  push_to(39, {0, 1});
  EXPECT_TRUE(filters_.is_settled(kY1));
  cycle_ = 50;
  push_to(57, {0, 1});
  EXPECT_FALSE(filters_.is_settled(kY1));
  push_to(58, {0, 1});
  EXPECT_TRUE(filters_.is_settled(kY1));
}

TEST_F(EstimatingFiltersTest, GiveNoNumberThatIsNone) {
  push_to(29, {0, 1});
  filters_.push(30, Fired{0, 1}, Rows{0.0, 0.0, std::numeric_limits<double>::quiet_NaN()});
  EXPECT_EQ(filters_.estimate(kY1).status, EstimateStatus::kSettling);
}

TEST_F(EstimatingFiltersTest, DoNotTouchTheHeap) {
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) {
    filters_.push(k, Fired{static_cast<std::uint8_t>(k / 50 % 2), 1}, Rows{1.0, 2.0, 0.2});
    static_cast<void>(filters_.estimate(kY1));
  }
  const std::uint64_t heap_calls = guard.heap_calls();
  EXPECT_EQ(heap_calls, 0u);
}

TEST(EstimatingFilters, TakeTheFilterWithTheSmallestBound) {
  Bank bank = observer_bank();
  bank.filters.push_back(bank.filters[1]);
  bank.filters[2].estimation->bound = 0.01;
  EstimatingFilters filters(bank);
  const std::array<std::uint8_t, 3> fired = {};
  for (std::uint32_t k = 0; k < 10; ++k) {
    filters.push(k, fired, std::array{0.0, 0.0, 0.2, 0.3});
  }
  EXPECT_EQ(filters.estimate(kY1).value, std::vector{0.3});
}

}  // namespace
}  // namespace faultline

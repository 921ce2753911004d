#include "tools/replay/result_comparison.h"

#include <cstdint>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace faultline {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr ResultChannel kChannel = ResultChannel::kResidual;

/// A message as lcm encodes it: fingerprint, utime, sequence, cycle, and one value.
Bytes message(std::int64_t sequence, std::int64_t cycle, std::uint8_t value = 7,
              std::int64_t utime = 1) {
  Bytes bytes;
  const auto add = [&](std::int64_t number) {
    for (int shift = 56; shift >= 0; shift -= 8) {
      bytes.push_back(static_cast<std::uint8_t>(static_cast<std::uint64_t>(number) >> shift));
    }
  };
  add(0x1234);
  add(utime);
  add(sequence);
  add(cycle);
  bytes.push_back(value);
  return bytes;
}

class ResultComparisonTest : public testing::Test {
 protected:
  void record(std::int64_t cycle, std::uint8_t value = 7) {
    for (const ResultChannel channel : {ResultChannel::kSample, kChannel}) {
      comparison_.on_recorded(channel, message(sequence_, cycle, value));
    }
    ++sequence_;
  }
  void replay(std::int64_t cycle, std::uint8_t value = 7) {
    for (const ResultChannel channel : {ResultChannel::kSample, kChannel}) {
      comparison_.on_replayed(channel, message(99, cycle, value, 5));
    }
  }
  [[nodiscard]] const ResultComparison::Counts& counts() const {
    return comparison_.counts(kChannel);
  }

  ResultComparison comparison_;
  std::int64_t sequence_ = 0;
};

TEST_F(ResultComparisonTest, TakesNeitherTimeNorSequenceNumberForAResult) {
  record(0);
  replay(0);
  EXPECT_EQ(counts().identical, 1U);
  EXPECT_EQ(counts().different, 0U);
}

TEST_F(ResultComparisonTest, LetsEitherSideWaitForTheOther) {
  for (std::int64_t k = 0; k < 500; ++k) record(k);
  for (std::int64_t k = 0; k < 1000; ++k) replay(k);
  for (std::int64_t k = 500; k < 1000; ++k) record(k);
  comparison_.finish(true);
  EXPECT_EQ(counts().identical, 1000U);
  EXPECT_EQ(counts().different + counts().unverifiable + counts().unrecorded, 0U);
}

TEST_F(ResultComparisonTest, KeepsTheFirstDifferenceByCycle) {
  for (std::int64_t k = 0; k < 10; ++k) record(k, k >= 6 ? 8 : 7);
  for (std::int64_t k = 0; k < 10; ++k) replay(k);
  EXPECT_EQ(counts().identical, 6U);
  EXPECT_EQ(counts().different, 4U);
  ASSERT_TRUE(comparison_.first_difference());
  EXPECT_EQ(comparison_.first_difference()->cycle, 6);
  EXPECT_EQ(comparison_.first_difference()->channel, ResultChannel::kSample);
  EXPECT_EQ(comparison_.first_difference()->recorded.back(), 8);
  EXPECT_EQ(comparison_.first_difference()->replayed.back(), 7);
}

TEST_F(ResultComparisonTest, CountsResultsThatTheLogLacks) {
  for (std::int64_t k = 0; k < 10; ++k) {
    replay(k);
    if (k == 3 || k == 4) {
      ++sequence_;  // lost
    } else {
      record(k);
    }
  }
  comparison_.finish(true);
  EXPECT_EQ(counts().identical, 8U);
  EXPECT_EQ(counts().unrecorded, 2U);
  EXPECT_EQ(counts().different + counts().unverifiable, 0U);
}

TEST_F(ResultComparisonTest, CountsMessagesThatComeAgain) {
  for (std::int64_t k = 0; k < 4; ++k) replay(k);
  record(0);
  --sequence_;
  record(0);
  record(1);
  EXPECT_EQ(counts().identical, 2U);
  EXPECT_EQ(counts().repeated, 1U);
  EXPECT_EQ(counts().different, 0U);
}

TEST_F(ResultComparisonTest, ResultsWithoutFramesAtTheEndAreNoDifferenceInALogThatLacksItsEnd) {
  for (std::int64_t k = 0; k < 5; ++k) record(k);
  for (std::int64_t k = 0; k < 3; ++k) replay(k);
  ResultComparison complete = comparison_;
  comparison_.finish(false);
  EXPECT_EQ(counts().behind_end, 2U);
  EXPECT_EQ(counts().different, 0U);
  complete.finish(true);
  EXPECT_EQ(complete.counts(kChannel).different, 2U);
  ASSERT_TRUE(complete.first_difference());
  EXPECT_EQ(complete.first_difference()->cycle, 3);
  EXPECT_THAT(complete.first_difference()->replayed, testing::IsEmpty());
}

TEST_F(ResultComparisonTest, BehindAGapDifferencesAreNotVerifiableUntilBothSidesAgreeForLong) {
  std::int64_t k = 0;
  const auto both = [&](std::uint8_t recorded, std::uint8_t replayed, std::int64_t count) {
    for (const std::int64_t end = k + count; k < end; ++k) {
      record(k, recorded);
      replay(k, replayed);
    }
  };
  both(7, 7, 10);
  comparison_.on_gap();
  both(7, 7, 5);  // not touched yet
  both(7, 8, 20);
  both(7, 7, ResultComparison::kSettled - 1);
  both(7, 8, 1);
  both(7, 7, ResultComparison::kSettled);
  EXPECT_EQ(counts().different, 0U);
  EXPECT_EQ(counts().unverifiable, 21U);
  both(7, 8, 1);
  EXPECT_EQ(counts().different, 1U);
  comparison_.finish(true);
  ASSERT_EQ(comparison_.unverifiable().size(), 2U);
  EXPECT_EQ(comparison_.unverifiable()[0].from, 15);
  EXPECT_EQ(comparison_.unverifiable()[0].to, 34);
  EXPECT_EQ(counts().recorded, counts().identical + counts().different + counts().unverifiable);
}

TEST_F(ResultComparisonTest, CyclesThatOnlyOneSideHasBehindAGapDoNotShiftTheOthers) {
  for (std::int64_t k = 0; k < 10; ++k) {
    record(k);
    replay(k);
  }
  comparison_.on_gap();
  for (std::int64_t k = 10; k < 200; ++k) {
    record(k);
    if (k < 20 || k >= 30) replay(k);
  }
  comparison_.finish(true);
  EXPECT_EQ(counts().unverifiable, 10U);
  EXPECT_EQ(counts().identical, 190U);
  EXPECT_EQ(counts().different, 0U);
}

TEST_F(ResultComparisonTest, ADiagnosisCountsAgainOnceResidualsDo) {
  constexpr auto kDiagnosis = ResultChannel::kDiagnosis;
  comparison_.on_gap();
  comparison_.on_recorded(kDiagnosis, message(0, 0));
  comparison_.on_replayed(kDiagnosis, message(0, 0));
  comparison_.on_recorded(kDiagnosis, message(1, 1, 9));
  comparison_.on_replayed(kDiagnosis, message(1, 1));
  EXPECT_EQ(comparison_.counts(kDiagnosis).unverifiable, 1U);
  for (std::int64_t k = 0; k < ResultComparison::kSettled; ++k) {
    record(k);
    replay(k);
  }
  comparison_.on_recorded(kDiagnosis, message(2, 100));
  comparison_.on_replayed(kDiagnosis, message(2, 100));
  comparison_.on_recorded(kDiagnosis, message(3, 101, 9));
  comparison_.on_replayed(kDiagnosis, message(3, 101));
  EXPECT_EQ(comparison_.counts(kDiagnosis).identical, 2U);
  EXPECT_EQ(comparison_.counts(kDiagnosis).different, 1U);
}

TEST_F(ResultComparisonTest, WhatWaitsIsBounded) {
  for (std::int64_t k = 0; k < 100'000; ++k) comparison_.on_recorded(kChannel, message(k, k));
  EXPECT_EQ(counts().unverifiable, 100'000U - ResultComparison::kMostWaiting);
  for (std::int64_t k = 0; k < 200'000; ++k) {
    comparison_.on_replayed(ResultChannel::kSample, message(k, k));
  }
  EXPECT_EQ(comparison_.counts(ResultChannel::kSample).unrecorded,
            200'000U - ResultComparison::kMostWaiting);
}

}  // namespace
}  // namespace faultline

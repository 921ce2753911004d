#include "tools/score/estimates.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace faultline {
namespace {

void expect_near(const Estimate& found, double value, double low, double high, double tolerance) {
  EXPECT_NEAR(found.value, value, tolerance);
  EXPECT_NEAR(found.low, low, tolerance);
  EXPECT_NEAR(found.high, high, tolerance);
}

// Published: Newcombe (1998), table I, method 5 (Clopper and Pearson).
TEST(Proportion, HasThePublishedIntervals) {
  expect_near(proportion(81, 263), 0.3080, 0.2527, 0.3676, 5e-5);
  expect_near(proportion(15, 148), 0.1014, 0.0578, 0.1617, 5e-5);
  expect_near(proportion(0, 20), 0.0, 0.0, 0.1684, 5e-5);
  expect_near(proportion(1, 29), 0.0345, 0.0009, 0.1776, 5e-5);
  expect_near(proportion(20, 20), 1.0, 0.8316, 1.0, 5e-5);
}

// Published: Garwood (1936); 0 and 10 events.
TEST(EventRate, HasThePublishedIntervals) {
  expect_near(event_rate(0, 1.0), 0.0, 0.0, 3.6889, 1e-4);
  expect_near(event_rate(10, 2.0), 5.0, 4.7954 / 2.0, 18.3904 / 2.0, 1e-4);
}

// Of 2000 repetitions 95 % hold the truth; by chance alone 93.5 % to 96.5 % do.
TEST(ClusteredRatio, HoldsTheTruthThoughCyclesOfARunAreAlike) {
  std::mt19937_64 draw(7);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  int held = 0;
  for (int repetition = 0; repetition < 2000; ++repetition) {
    std::vector<double> part, whole;
    for (int run = 0; run < 200; ++run) {
      const double length = 50.0 + 100.0 * unit(draw);
      const double share = unit(draw);  // of this run: its cycles are alike
      part.push_back(share * length);
      whole.push_back(length);
    }
    const auto ratio = clustered_ratio(part, whole);
    ASSERT_TRUE(ratio);
    held += ratio->low <= 0.5 && 0.5 <= ratio->high ? 1 : 0;
  }
  EXPECT_GE(held, 1870);
  EXPECT_LE(held, 1930);
}

// Of 100 runs 3 have false alarms, for half of the run: 1.96 standard deviations to both sides of
// such a ratio hold the truth in 86 % of the cases.
TEST(ClusteredRatio, HoldsTheTruthThoughItIsRare) {
  std::mt19937_64 draw(9);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  int held = 0;
  for (int repetition = 0; repetition < 2000; ++repetition) {
    std::vector<double> part(100), whole(100);
    for (std::size_t run = 0; run < whole.size(); ++run) {
      whole[run] = 50.0 + 100.0 * unit(draw);
      const double share = unit(draw);
      part[run] = unit(draw) < 0.03 ? share * whole[run] : 0.0;
    }
    const auto ratio = clustered_ratio(part, whole);
    ASSERT_TRUE(ratio);
    held += ratio->low <= 0.015 && 0.015 <= ratio->high ? 1 : 0;
  }
  EXPECT_GE(held, 1810);
}

TEST(ClusteredRatio, IsThatOfTrialsWhereARunIsAllOrNothing) {
  std::vector<double> part(200, 0.0);
  const std::vector<double> whole(200, 7.0);
  for (std::size_t run = 0; run < 60; ++run) part[run] = 7.0;
  const Estimate trials = proportion(60, 200);
  expect_near(*clustered_ratio(part, whole), trials.value, trials.low, trials.high, 1e-3);
}

TEST(ClusteredRatio, OfRunsThatAllAgreeIsNotCertain) {
  const std::vector<double> none(20, 0.0), whole(20, 100.0);
  expect_near(*clustered_ratio(none, whole), 0.0, 0.0, 0.1684, 5e-5);
  expect_near(*clustered_ratio(whole, whole), 1.0, 0.8316, 1.0, 5e-5);
  const std::vector<double> half(20, 50.0);
  const Estimate trials = proportion(10, 20);
  expect_near(*clustered_ratio(half, whole), 0.5, trials.low, trials.high, 1e-12);
  EXPECT_FALSE(clustered_ratio(none, none));
}

// Ranks of the median's interval of 20 values are the 6th and the 15th (Conover's table).
TEST(Quantile, IsAnOrderStatisticBetweenTwoOthers) {
  std::vector<double> values;
  for (int i = 1; i <= 20; ++i) values.push_back(i);
  expect_near(*quantile(values, 0, 0.5), 10.0, 6.0, 15.0, 0.0);
  const auto p95 = quantile(values, 0, 0.95);
  EXPECT_EQ(p95->value, 19.0);
  EXPECT_TRUE(std::isinf(p95->high));  // all 20 lie below it with 36 %
}

TEST(Quantile, HasNoLowerBoundOfFewValues) {
  const std::vector<double> values{-1.0, 2.0, 3.0};
  EXPECT_TRUE(std::isinf(quantile(values, 0, 0.5)->low));
  EXPECT_TRUE(std::isinf(quantile(values, 0, 0.5)->high));
}

TEST(Quantile, CountsThoseThatWereNotFound) {
  const std::vector<double> values{1.0, 2.0, 3.0, 4.0, 5.0, 6.0};
  EXPECT_EQ(quantile(values, 4, 0.5)->value, 5.0);
  EXPECT_TRUE(std::isinf(quantile(values, 7, 0.5)->value));
  EXPECT_FALSE(quantile({}, 0, 0.5));
  EXPECT_TRUE(std::isinf(quantile({}, 3, 0.5)->value));
}

TEST(AreaUnderRoc, CountsPairs) {
  EXPECT_EQ(area_under_roc({1, 2, 3}, {4, 5})->value, 1.0);
  EXPECT_EQ(area_under_roc({4, 5}, {1, 2, 3})->value, 0.0);
  EXPECT_EQ(area_under_roc({1, 2}, {2, 3})->value, 3.5 / 4.0);
  EXPECT_FALSE(area_under_roc({}, {1.0}));
  // Hanley and McNeil (1982): area 0.893, standard error 0.032 with 51 ill and 58 well.
  std::vector<double> well(58), ill(51);
  for (std::size_t i = 0; i < well.size(); ++i) well[i] = static_cast<double>(i) / 58.0;
  for (std::size_t i = 0; i < ill.size(); ++i) ill[i] = 0.5374 + static_cast<double>(i) / 51.0;
  const auto area = area_under_roc(well, ill);
  EXPECT_NEAR(area->value, 0.893, 0.01);
  EXPECT_NEAR((area->high - area->low) / (2.0 * 1.96), 0.032, 0.001);
}

TEST(AreaUnderRoc, OfFewValuesIsNotTakenForCertain) {
  const auto area = area_under_roc({1, 2, 3}, {4, 5});
  EXPECT_EQ(area->high, 1.0);
  EXPECT_LT(area->low, 0.6);
  EXPECT_GT(area->low, 0.2);
  const auto none = area_under_roc({4, 5}, {1, 2, 3});
  EXPECT_EQ(none->low, 0.0);
  EXPECT_NEAR(none->high, 1.0 - area->low, 1e-12);
}

// Normal values 2.66 deviations apart: the area is Φ(2.66 / √2) = 0.97.
TEST(AreaUnderRoc, HoldsTheTruthThoughItIsNearOne) {
  std::mt19937_64 draw(11);
  std::normal_distribution<double> normal;
  const double truth = 0.5 * std::erfc(-2.66 / 2.0);
  int held = 0;
  constexpr int kRepetitions = 1000;
  for (int repetition = 0; repetition < kRepetitions; ++repetition) {
    std::vector<double> without(20), with(20);
    for (double& value : without) value = normal(draw);
    for (double& value : with) value = 2.66 + normal(draw);
    const auto area = area_under_roc(without, with);
    if (area->low <= truth && truth <= area->high) ++held;
  }
  EXPECT_GE(held, 930);
}

// 3000 faults, found with the probability that the curve says. True size at 95 %: e^(ln 19 / 4).
TEST(DetectableSize, IsWhereTheCurveSaysSo) {
  std::mt19937_64 draw(3);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const double truth = std::exp(std::log(19.0) / 4.0);
  int held = 0;
  for (int repetition = 0; repetition < 200; ++repetition) {
    std::vector<Trial> trials;
    for (int i = 0; i < 500; ++i) {
      const double size = std::exp(-2.0 + 4.0 * unit(draw));
      const double p = 1.0 / (1.0 + std::exp(-4.0 * std::log(size)));
      trials.push_back({size, unit(draw) < p});
    }
    const DetectableSize found = detectable_size(trials);
    ASSERT_EQ(found.kind, DetectableSize::Kind::kEstimated);
    held += found.size.low <= truth && truth <= found.size.high ? 1 : 0;
  }
  EXPECT_GE(held, 181);  // 190 expected; 3 standard deviations
}

TEST(DetectableSize, LiesBetweenMissedAndFoundWhereNoChanceIsInIt) {
  std::vector<Trial> trials;
  for (int i = 1; i <= 100; ++i) trials.push_back({0.01 * i, i > 50});
  const DetectableSize found = detectable_size(trials);
  EXPECT_EQ(found.kind, DetectableSize::Kind::kEstimated);
  EXPECT_EQ(found.size.low, 0.5);
  EXPECT_EQ(found.size.high, 0.51);
}

TEST(DetectableSize, SaysWhatTheDataDoNotCarry) {
  using Kind = DetectableSize::Kind;
  std::vector<Trial> found, missed, reversed;
  for (int i = 1; i <= 40; ++i) {
    found.push_back({0.1 * i, true});
    missed.push_back({0.1 * i, false});
    reversed.push_back({0.1 * i, i < 20});
  }
  EXPECT_EQ(detectable_size(found).kind, Kind::kBelowAll);
  EXPECT_EQ(detectable_size(found).size.value, 0.1);
  EXPECT_EQ(detectable_size(missed).kind, Kind::kAboveAll);
  EXPECT_EQ(detectable_size(reversed).kind, Kind::kUndecided);
  EXPECT_EQ(detectable_size({}).kind, Kind::kUndecided);
  EXPECT_EQ(detectable_size({{1.0, false}, {2.0, true}}).kind, Kind::kUndecided);
}

}  // namespace
}  // namespace faultline

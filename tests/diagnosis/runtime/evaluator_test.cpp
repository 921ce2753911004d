#include "diagnosis/runtime/evaluator.h"

#include <array>
#include <limits>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

/// Two residuals, stepped with threshold 1: the first uses y1 and u1, the second y2 only.
Bank two_residuals(std::uint32_t dwell) {
  Bank bank;
  bank.decision.dwell = dwell;
  bank.output_names = {"y1", "y2"};
  bank.input_names = {"u1"};
  for (int i = 0; i < 2; ++i) {
    ResidualFilter filter;
    filter.F = filter.M = Eigen::MatrixXd::Constant(1, 1, 0.5);
    filter.E = Eigen::RowVector2d::Unit(i);
    filter.H = Eigen::RowVector2d::Zero();
    filter.G = Eigen::MatrixXd::Constant(1, 1, i == 0 ? 1.0 : 0.0);
    filter.K = Eigen::MatrixXd::Zero(1, 1);
    filter.forget_samples = 2;
    bank.filters.push_back(filter);
  }
  return bank;
}

void step(Evaluator& evaluator, double first, double second) {
  const std::array<double, 2> evaluation = {first, second};
  constexpr std::array<double, 2> kThresholds = {1.0, 1.0};
  evaluator.step(evaluation, kThresholds);
}

TEST(Evaluator, FiresAfterDwellSamplesStrictlyAboveTheThreshold) {
  Evaluator evaluator(two_residuals(3));
  for (int k = 0; k < 5; ++k) {
    step(evaluator, 1.0, 1.1);  // 1.0 is not above 1.0
    EXPECT_EQ(evaluator.fired()[0], 0) << k;
    EXPECT_EQ(evaluator.fired()[1], k < 2 ? 0 : 1) << k;
  }
  EXPECT_EQ(evaluator.signature()[0], 0b10u);
}

TEST(Evaluator, ClearsAfterDwellSamplesNotAbove) {
  Evaluator evaluator(two_residuals(2));
  step(evaluator, 2.0, 0.0);
  step(evaluator, 2.0, 0.0);
  EXPECT_EQ(evaluator.fired()[0], 1);
  step(evaluator, 1.0, 0.0);
  EXPECT_EQ(evaluator.fired()[0], 1);
  step(evaluator, 1.0, 0.0);
  EXPECT_EQ(evaluator.fired()[0], 0);
  EXPECT_EQ(evaluator.signature()[0], 0u);
}

TEST(Evaluator, StartsCountingAgainWhenARunIsBroken) {
  Evaluator evaluator(two_residuals(2));
  step(evaluator, 2.0, 0.0);
  step(evaluator, 0.0, 0.0);
  step(evaluator, 2.0, 0.0);
  EXPECT_EQ(evaluator.fired()[0], 0);
  step(evaluator, 2.0, 0.0);
  EXPECT_EQ(evaluator.fired()[0], 1);
}

TEST(Evaluator, KnowsWhenTheRunBeganThatMadeAResidualFireOrClear) {
  Evaluator evaluator(two_residuals(3));
  for (int k = 0; k < 10; ++k) {
    step(evaluator, k >= 4 ? 2.0 : 0.0, 0.0);
  }
  EXPECT_EQ(evaluator.crossing_age(0), 9u - 4u);
  for (int k = 10; k < 20; ++k) {
    step(evaluator, k >= 15 ? 0.0 : 2.0, 0.0);
  }
  EXPECT_EQ(evaluator.crossing_age(0), 19u - 15u);
}

TEST(Evaluator, TakesANanAsAboveTheThreshold) {
  Evaluator evaluator(two_residuals(1));
  step(evaluator, std::numeric_limits<double>::quiet_NaN(), 0.0);
  EXPECT_EQ(evaluator.fired()[0], 1);
}

TEST(Evaluator, ContaminatesOnlyTheResidualsThatUseTheBadChannel) {
  Evaluator evaluator(two_residuals(1));
  const std::array<std::uint8_t, 2> y_is_fresh = {1, 1};
  const std::array<std::uint8_t, 1> u_is_stale = {0};
  evaluator.contaminate(y_is_fresh, u_is_stale);
  step(evaluator, 2.0, 2.0);
  EXPECT_TRUE(evaluator.is_any_contaminated());
  EXPECT_EQ(evaluator.fired()[0], 0);
  EXPECT_EQ(evaluator.fired()[1], 1);
}

TEST(Evaluator, ContaminatesResidualsThatUseTheBadChannelInALipschitzTermAlone) {
  Bank bank = two_residuals(1);
  FilterNonlinearity term;
  term.W = term.a_v = Eigen::VectorXd::Ones(1);
  term.a_y = Eigen::VectorXd::Zero(2);
  term.a_u = Eigen::VectorXd::Ones(1);
  bank.filters[1].nonlinearities = {term};
  Evaluator evaluator(bank);
  evaluator.contaminate(std::array<std::uint8_t, 2>{1, 1}, std::array<std::uint8_t, 1>{0});
  step(evaluator, 2.0, 2.0);
  EXPECT_EQ(evaluator.signature()[0], 0u);
  term.a_y = Eigen::Vector2d::UnitX();
  term.a_u = Eigen::VectorXd::Zero(1);
  bank.filters[1].nonlinearities = {term};
  Evaluator other(bank);
  other.contaminate(std::array<std::uint8_t, 2>{0, 1}, std::array<std::uint8_t, 1>{1});
  step(other, 2.0, 2.0);
  EXPECT_EQ(other.signature()[0], 0u);
}

TEST(Evaluator, StaysContaminatedForForgetSamplesAndCountsTheDwellFromThere) {
  Evaluator evaluator(two_residuals(2));
  evaluator.contaminate_all();
  EXPECT_TRUE(evaluator.is_any_contaminated());
  for (int k = 0; k < 2; ++k) {
    step(evaluator, 2.0, 2.0);
    EXPECT_TRUE(evaluator.is_any_contaminated()) << k;
  }
  step(evaluator, 2.0, 2.0);
  EXPECT_FALSE(evaluator.is_any_contaminated());
  EXPECT_EQ(evaluator.fired()[0], 0);
  step(evaluator, 2.0, 2.0);
  EXPECT_EQ(evaluator.fired()[0], 1);
}

TEST(Evaluator, NeitherClearsWhileContaminated) {
  Evaluator evaluator(two_residuals(1));
  step(evaluator, 2.0, 2.0);
  evaluator.contaminate_all();
  step(evaluator, 0.0, 0.0);
  EXPECT_EQ(evaluator.signature()[0], 0b11u);
}

TEST(Evaluator, ForgetsEverythingOnReset) {
  Evaluator evaluator(two_residuals(1));
  step(evaluator, 2.0, 2.0);
  evaluator.contaminate_all();
  evaluator.reset();
  EXPECT_FALSE(evaluator.is_any_contaminated());
  EXPECT_EQ(evaluator.signature()[0], 0u);
  step(evaluator, 2.0, 0.0);
  EXPECT_EQ(evaluator.signature()[0], 0b01u);
}

TEST(Evaluator, ComparesWithTheThresholdsOfEachSample) {
  Evaluator evaluator(two_residuals(1));
  for (const double threshold : {1.0, 2.0, 0.5}) {
    evaluator.step(std::array{1.5, 1.5}, std::array{threshold, 10.0});
    EXPECT_EQ(evaluator.fired()[0], threshold < 1.5 ? 1 : 0);
  }
  evaluator.step(std::array{0.0, 0.0}, std::array{std::numeric_limits<double>::quiet_NaN(), 1.0});
  EXPECT_EQ(evaluator.fired()[0], 1);
}

/// The first residual, of which a transient lasts 4 samples at most, has a course.
Bank first_is_an_observer(std::uint32_t dwell) {
  Bank bank = two_residuals(dwell);
  bank.filters[0].transient_samples = 4;
  bank.filters[0].course = ThresholdCourse();
  return bank;
}

TEST(Evaluator, StartsWithResidualsThatHaveACourseAtOnce) {
  Evaluator evaluator(first_is_an_observer(1));
  evaluator.contaminate_start();
  step(evaluator, 2.0, 2.0);
  EXPECT_EQ(evaluator.signature()[0], 0b01u);
  EXPECT_TRUE(evaluator.is_any_contaminated()) << "the other one";
  evaluator.reset();
  evaluator.contaminate_all();
  step(evaluator, 2.0, 2.0);
  EXPECT_EQ(evaluator.signature()[0], 0u) << "a bad sample is another matter";
}

TEST(Evaluator, CallsAResidualPersistentThatFiresLongerThanATransient) {
  for (const std::uint32_t dwell : {1u, 3u}) {
    Evaluator evaluator(first_is_an_observer(dwell));
    for (std::uint32_t above = 0; above < 4; ++above) step(evaluator, 2.0, 2.0);
    for (int k = 0; k < 20; ++k) {
      step(evaluator, 0.0, 2.0);
      EXPECT_EQ(evaluator.persistent()[0], 0u) << "above for 4 samples is no more than 4";
    }
    for (std::uint32_t above = 0; above < 4 + dwell; ++above) {
      EXPECT_EQ(evaluator.persistent()[0], 0u) << above;
      step(evaluator, 2.0, 2.0);
    }
    EXPECT_EQ(evaluator.persistent()[0], 0b01u) << "the other one never is";
    for (int k = 0; k < 100; ++k) step(evaluator, 2.0, 2.0);
    EXPECT_EQ(evaluator.persistent()[0], 0b01u);
    for (std::uint32_t below = 0; below < dwell; ++below) step(evaluator, 0.0, 2.0);
    EXPECT_EQ(evaluator.persistent()[0], 0u);
  }
}

TEST(Evaluator, CountsAgainWhatABadSampleMayHaveMadeFire) {
  Evaluator evaluator(first_is_an_observer(1));
  for (int k = 0; k < 10; ++k) step(evaluator, 2.0, 2.0);
  EXPECT_EQ(evaluator.persistent()[0], 0b01u);
  evaluator.contaminate_all();
  for (int k = 0; k < 2; ++k) {
    step(evaluator, 2.0, 2.0);
    EXPECT_EQ(evaluator.persistent()[0], 0u) << "contaminated";
  }
  for (int k = 0; k < 4; ++k) {
    step(evaluator, 2.0, 2.0);
    EXPECT_EQ(evaluator.persistent()[0], 0u) << k;
  }
  step(evaluator, 2.0, 2.0);
  EXPECT_EQ(evaluator.persistent()[0], 0b01u);
  evaluator.reset();
  EXPECT_EQ(evaluator.persistent()[0], 0u);
}

TEST(Evaluator, PutsMoreThan64ResidualsIntoSeveralWords) {
  Bank bank = two_residuals(1);
  bank.filters.resize(70, bank.filters[0]);
  Evaluator evaluator(bank);
  std::array<double, 70> evaluation = {};
  evaluation[65] = 2.0;
  std::array<double, 70> thresholds = {};
  thresholds.fill(1.0);
  evaluator.step(evaluation, thresholds);
  ASSERT_EQ(evaluator.signature().size(), 2u);
  EXPECT_EQ(evaluator.signature()[0], 0u);
  EXPECT_EQ(evaluator.signature()[1], 0b10u);
}

TEST(Evaluator, DoesNotTouchTheHeapInAThousandSteps) {
  Evaluator evaluator(two_residuals(2));
  const std::array<std::uint8_t, 2> y_is_fresh = {1, 0};
  const std::array<std::uint8_t, 1> u_is_fresh = {1};
  const AllocationGuard guard;
  for (int k = 0; k < 1000; ++k) {
    if (k % 50 == 0) {
      evaluator.contaminate(y_is_fresh, u_is_fresh);
    }
    step(evaluator, k % 3, k % 5);
    if (k % 400 == 0) {
      evaluator.contaminate_all();
      evaluator.reset();
    }
  }
  const std::uint64_t heap_calls = guard.heap_calls();
  EXPECT_EQ(heap_calls, 0u);
}

}  // namespace
}  // namespace faultline

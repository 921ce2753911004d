#include "diagnosis/certify/sequential_rates.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "diagnosis/bank/bank.h"
#include "diagnosis/runtime/residual_bank.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

// A bank whose residual is y itself, under a sequential test.
Bank white_bank(const SequentialTest& test, double threshold) {
  Bank bank;
  bank.output_names = {"y"};
  bank.fault_names = {"y"};
  bank.fault_sizes = {1.0};
  bank.sample_time_s = 0.01;
  bank.y_operating = Eigen::VectorXd::Zero(1);
  bank.u_operating = Eigen::VectorXd::Zero(0);
  ResidualFilter filter;
  filter.name = "r0";
  filter.sees = {Sensitivity::kSteady};
  filter.F.resize(0, 0);
  filter.E.resize(0, 1);
  filter.G.resize(0, 0);
  filter.M.resize(1, 0);
  filter.H = -Eigen::MatrixXd::Identity(1, 1);
  filter.K.resize(1, 0);
  filter.L.resize(0, 1);
  filter.J = Eigen::MatrixXd::Identity(1, 1);
  filter.threshold = threshold;
  filter.test = test;
  bank.filters.push_back(filter);
  return bank;
}

// Mean number of samples until the statistic is above its threshold, of white noise with this mean.
double mean_run_length(const SequentialTest& test, double threshold, double mean, int runs) {
  const Bank bank = white_bank(test, threshold);
  ResidualBank filters(bank);
  std::mt19937_64 draw(test_seed(20261210));
  std::normal_distribution<double> normal(mean, 1.0);
  double total = 0.0;
  for (int i = 0; i < runs; ++i) {
    filters.reset();
    do {
      const double y = normal(draw);
      filters.step({&y, 1}, {});
      total += 1.0;
    } while (filters.evaluation()[0] <= threshold);
  }
  return total / runs;
}

SequentialTest cusum(double reference) { return {TestKind::kCusum, reference, 0, {0.0}}; }

// Of published tables (Hawkins, Olwell, Cumulative Sum Charts, 1998; Lucas, Crosier 1982): two
// sides halve the one-sided run length.
TEST(CusumRunLength, IsThatOfTheTables) {
  EXPECT_NEAR(cusum_run_length(0.5, 4.0) / 2.0, 168.0, 1.0);
  EXPECT_NEAR(cusum_run_length(0.5, 5.0) / 2.0, 465.0, 1.0);
  EXPECT_NEAR(cusum_run_length(0.5, 5.0, 1.0), 10.4, 0.05);
  EXPECT_NEAR(cusum_run_length(0.5, 4.0, 1.0), 8.38, 0.05);
}

TEST(CusumRunLength, IsThatOfTheTestItself) {
  for (const auto& [reference, threshold] : {std::pair{0.25, 7.0}, {0.5, 4.0}, {1.0, 2.0}}) {
    // The two sides exclude each other, nearly.
    const double found = mean_run_length(cusum(reference), threshold, 0.0, 4000);
    const double expected = 0.5 * cusum_run_length(reference, threshold);
    EXPECT_NEAR(found, expected, 0.06 * expected) << reference;
    const double detected = mean_run_length(cusum(reference), threshold, 2.0 * reference, 4000);
    const double delay = cusum_run_length(reference, threshold, 2.0 * reference);
    EXPECT_NEAR(detected, delay, 0.05 * delay) << reference;
  }
}

TEST(CusumThreshold, IsThatOfItsRate) {
  for (const double reference : {0.05, 0.25, 0.5, 1.5}) {
    for (const double rate : {1e-3, 1e-6, 1e-9}) {
      const double h = cusum_threshold(reference, rate);
      // Siegmund's approximation where h is long.
      const double allowed = h > 80.0 ? 0.02 : 1e-3;
      EXPECT_NEAR(cusum_run_length(reference, h) * rate, 1.0, allowed) << reference << ' ' << rate;
    }
    // Rarer ones by the slope of the logarithm.
    EXPECT_NEAR(cusum_threshold(reference, 1e-11) - cusum_threshold(reference, 0.99e-10),
                std::log(9.9) / (2.0 * reference), 0.02 / reference);
  }
}

TEST(CusumThreshold, OfASmallReferenceIsLong) {
  const double h = cusum_threshold(0.01, 1e-5);
  EXPECT_GT(h, 80.0);
  EXPECT_NEAR(mean_run_length(cusum(0.01), h, 0.0, 300), 50'000.0, 8000.0);
}

TEST(GlrRate, IsThatOfTheTestItself) {
  for (const std::uint32_t window : {10u, 50u, 200u}) {
    const double threshold = glr_threshold(window, 1e-3);
    EXPECT_NEAR(glr_rate(threshold, window), 1e-3, 1e-8);
    const SequentialTest test{TestKind::kGlr, 0.0, window, {0.0}};
    const double found = 1.0 / mean_run_length(test, threshold, 0.0, 600);
    EXPECT_NEAR(found, 1e-3, 0.15e-3) << window;
  }
}

TEST(GlrRate, OfOneSampleIsThatOfTwoTails) {
  // Of 5 standard deviations, asymptotically.
  EXPECT_NEAR(glr_rate(0.5 * 25.0, 1) / (2.0 * 2.8665e-7), 1.0, 0.06);
}

TEST(SequentialTest, OfWhatIsBoundedFindsNothing) {
  // A mean of 0.3 that something bounded may have, and no other noise.
  for (const TestKind kind : {TestKind::kCusum, TestKind::kGlr}) {
    const Bank bank = white_bank({kind, 0.25, kind == TestKind::kGlr ? 100u : 0u, {0.3}}, 5.0);
    ResidualBank filters(bank);
    for (int k = 0; k < 10'000; ++k) {
      const double y = k % 3000 < 1500 ? 0.3 : -0.3;
      filters.step({&y, 1}, {});
      ASSERT_LT(filters.evaluation()[0], 1e-12);
    }
  }
}

TEST(SequentialTest, ClearsAfterAFaultHoweverLongItLasted) {
  const Bank bank = white_bank(cusum(0.5), 6.0);
  ResidualBank filters(bank);
  double y = 5.0;
  for (int k = 0; k < 100'000; ++k) filters.step({&y, 1}, {});
  EXPECT_EQ(filters.evaluation()[0], 12.0);
  y = 0.0;
  int samples = 0;
  for (; filters.evaluation()[0] > 6.0; ++samples) filters.step({&y, 1}, {});
  EXPECT_EQ(samples, 12);  // h / κ
}

TEST(SequentialTest, BeginsAnewWhereItIsContaminated) {
  for (const TestKind kind : {TestKind::kCusum, TestKind::kGlr}) {
    const Bank bank = white_bank({kind, 0.5, kind == TestKind::kGlr ? 20u : 0u, {0.0}}, 6.0);
    ResidualBank filters(bank);
    const double y = 3.0;
    for (int k = 0; k < 5; ++k) filters.step({&y, 1}, {});
    EXPECT_GT(filters.evaluation()[0], 6.0);
    const std::uint8_t no = 0, yes = 1;
    filters.restart_tests({&no, 1});
    filters.step({&y, 1}, {});
    EXPECT_GT(filters.evaluation()[0], 6.0);
    filters.restart_tests({&yes, 1});
    filters.step({&y, 1}, {});
    EXPECT_DOUBLE_EQ(filters.evaluation()[0], kind == TestKind::kCusum ? 2.5 : 4.5);
    filters.reset();
    filters.step({&y, 1}, {});
    EXPECT_DOUBLE_EQ(filters.evaluation()[0], kind == TestKind::kCusum ? 2.5 : 4.5);
  }
}

TEST(SequentialTest, StepsWithoutAllocation) {
  for (const TestKind kind : {TestKind::kCusum, TestKind::kGlr}) {
    const Bank bank = white_bank({kind, 0.5, kind == TestKind::kGlr ? 200u : 0u, {0.0}}, 6.0);
    ResidualBank filters(bank);
    const std::uint8_t contaminated = 1;
    const AllocationGuard guard;
    for (int k = 0; k < 1000; ++k) {
      const double y = 0.01 * (k % 7);
      filters.step({&y, 1}, {});
      if (k % 300 == 299) filters.restart_tests({&contaminated, 1});
    }
    filters.reset();
    const std::uint64_t heap_calls = guard.heap_calls();
    EXPECT_EQ(heap_calls, 0u);
  }
}

TEST(SequentialTest, ShowsANan) {
  for (const TestKind kind : {TestKind::kCusum, TestKind::kGlr}) {
    const Bank bank = white_bank({kind, 0.5, kind == TestKind::kGlr ? 20u : 0u, {0.0}}, 6.0);
    ResidualBank filters(bank);
    const double y = std::nan("");
    filters.step({&y, 1}, {});
    EXPECT_TRUE(std::isnan(filters.evaluation()[0]));
  }
}

}  // namespace
}  // namespace faultline

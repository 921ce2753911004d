#include "diagnosis/runtime/estimator.h"

#include <array>
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/discretize.h"
#include "diagnosis/model/riccati.h"
#include "diagnosis/runtime/residual_bank.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Faults = std::vector<std::size_t>;

constexpr double kSampleTime_s = 0.01;
constexpr std::int64_t kLongAgo = -1;

/// Hou's bank designed on the sampled plant, where the internal form is exact; the filters forget
/// as fast as those that are designed in continuous time with poles at -10.
Bank sampled_bank() {
  BankRequest request = hou_request();
  request.domain = DesignDomain::kSampled;
  request.poles = {std::exp(-10.0 * kSampleTime_s)};
  return design_bank(hou_plant(), request).bank;
}

/// Hou's plant under u = -K x + 1 and his bank on it, with faults on the actuators and white errors
/// on the outputs as the bank sees them. Shares nothing with the filters' internal form.
class HouLoop {
 public:
  explicit HouLoop(const Bank& bank)
      : filters_(bank),
        C_(hou_plant().C),
        sampled_(discretize_zoh(hou_plant().A, hou_plant().B, kSampleTime_s)) {
    K_ = lqr_gain(sampled_.A, sampled_.B, MatrixXd::Identity(3, 3), MatrixXd::Identity(4, 4));
  }

  VectorXd x = VectorXd::Zero(3);
  VectorXd fault = VectorXd::Zero(4);
  double sigma = 0.0;                   // of the errors of the outputs
  VectorXd offset = VectorXd::Zero(3);  // their mean

  /// One sample: cycle `cycle()` before the call.
  void step(std::mt19937_64& engine) {
    const VectorXd u = VectorXd::Ones(4) - K_ * x;
    VectorXd y = C_ * x + offset;
    for (double& value : y) {
      value += sigma * normal_(engine);
    }
    filters_.step({y.data(), 3}, {u.data(), 4});
    x = (sampled_.A * x + sampled_.B * (u + fault)).eval();
    ++cycle_;
  }
  void step(std::mt19937_64& engine, MagnitudeEstimator& estimator, int count) {
    for (int i = 0; i < count; ++i) {
      step(engine);
      estimator.push(cycle_ - 1, filters_.residual());
    }
  }
  void forget() { filters_.reset(); }
  [[nodiscard]] std::uint32_t cycle() const { return cycle_; }
  [[nodiscard]] std::span<const double> evaluation() const { return filters_.evaluation(); }

 private:
  ResidualBank filters_;
  MatrixXd C_;
  SampledSystem sampled_;
  MatrixXd K_;
  std::normal_distribution<double> normal_;
  std::uint32_t cycle_ = 0;
};

/// Filters in internal form, for banks that no plant stands behind.
class InternalBank {
 public:
  explicit InternalBank(std::uint64_t seed) : engine_(seed) {}

  MatrixXd matrix(Index rows, Index cols) {
    return MatrixXd::NullaryExpr(rows, cols, [this] { return normal_(engine_); });
  }
  ResidualFilter filter(Index order, Index rows, Index faults, Index outputs) {
    ResidualFilter filter;
    filter.F =
        0.5 / std::sqrt(std::max<double>(static_cast<double>(order), 1.0)) * matrix(order, order);
    filter.E = matrix(order, outputs);
    filter.G = matrix(order, 1);
    filter.M = matrix(rows, order);
    filter.H = matrix(rows, outputs);
    filter.K = matrix(rows, 1);
    filter.L = matrix(order, faults);
    filter.J = matrix(rows, faults);
    filter.threshold = 1.0;
    return filter;
  }
  Bank bank(std::size_t faults, std::size_t outputs) {
    Bank bank;
    bank.concurrent = faults;
    bank.fault_names.resize(faults);
    bank.output_names.resize(outputs);
    bank.input_names.resize(1);
    return bank;
  }
  /// The residuals of `bank` from the errors `e`, which are stepped, under constant faults `m`.
  static std::vector<double> step(const Bank& bank, const VectorXd& m, std::vector<VectorXd>& e) {
    std::vector<double> residual;
    for (std::size_t i = 0; i < bank.filters.size(); ++i) {
      const ResidualFilter& filter = bank.filters[i];
      const VectorXd r = filter.M * e[i] - filter.J * m;
      residual.insert(residual.end(), r.begin(), r.end());
      e[i] = (filter.F * e[i] - filter.L * m).eval();
    }
    return residual;
  }

 private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

TEST(MagnitudeEstimator, IsExactForFaultsThatBeganBeforeTheWindow) {
  std::mt19937_64 engine(1);
  const Bank bank = sampled_bank();
  for (const int past : {0, 1, 7, 300}) {
    SCOPED_TRACE(past);
    MagnitudeEstimator estimator(bank);
    HouLoop loop(bank);
    loop.step(engine, estimator, 100);
    loop.fault << 0.0, 2.0, -1.5, 0.0;
    const std::uint32_t onset = loop.cycle();
    loop.step(engine, estimator, past + 50);
    const MagnitudeEstimate& found = estimator.estimate(Faults{1, 2}, onset);
    ASSERT_EQ(found.status, EstimateStatus::kValid);
    EXPECT_EQ(found.faults, (Faults{1, 2}));
    EXPECT_NEAR(found.value[0], 2.0, 1e-10);
    EXPECT_NEAR(found.value[1], -1.5, 1e-10);
    EXPECT_NEAR(found.deviation[0], 0.0, 1e-10);
  }
}

TEST(MagnitudeEstimator, IsAsGoodAsTheInternalFormForFiltersDesignedInContinuousTime) {
  // Between samples the outputs are no straight lines: the internal form is right to about
  // (pole·sample time)²/12 of the fault, 8e-4.
  std::mt19937_64 engine(1);
  const Bank bank = hou_bank();
  MagnitudeEstimator estimator(bank);
  HouLoop loop(bank);
  loop.step(engine, estimator, 1000);
  loop.fault << 0.0, 2.0, -1.5, 0.0;
  loop.step(engine, estimator, 50);
  const MagnitudeEstimate& found = estimator.estimate(Faults{1, 2}, 1000);
  EXPECT_NEAR(found.value[0], 2.0, 2e-3);
  EXPECT_NEAR(found.value[1], -1.5, 2e-3);
}

TEST(MagnitudeEstimator, DoesNotMindWhatHappenedBeforeTheWindow) {
  std::mt19937_64 engine(1);
  const Bank bank = sampled_bank();
  MagnitudeEstimator estimator(bank);
  HouLoop loop(bank);
  loop.x << 3.0, -20.0, 10.0;  // the filters start at zero: their e_0 is wrong
  loop.fault << 50.0, 0.0, 0.0, -30.0;
  loop.step(engine, estimator, 5);
  loop.fault << 0.0, 0.0, 1.0, 0.0;
  loop.step(engine, estimator, 5);
  loop.forget();
  loop.fault << 0.0, 0.0, 0.7, 0.0;
  const std::uint32_t onset = loop.cycle();
  loop.step(engine, estimator, 50);
  const MagnitudeEstimate& found = estimator.estimate(Faults{2}, onset);
  ASSERT_EQ(found.status, EstimateStatus::kValid);
  EXPECT_NEAR(found.value[0], 0.7, 1e-9);
}

TEST(MagnitudeEstimator, IsExactForFiltersOfAllShapes) {
  const std::uint64_t seed = test_seed(51);
  SCOPED_TRACE(seed_message(seed));
  InternalBank random(seed);
  for (int repeat = 0; repeat < 20; ++repeat) {
    Bank bank = random.bank(3, 2);
    bank.decision.window = 20;
    std::vector<VectorXd> e;
    for (const auto& [order, rows] : {std::pair{0, 1}, {1, 1}, {4, 1}, {3, 2}, {6, 3}, {25, 1}}) {
      bank.filters.push_back(random.filter(order, rows, 3, 2));
      e.push_back(10.0 * random.matrix(order, 1));
    }
    MagnitudeEstimator estimator(bank);
    const VectorXd m = random.matrix(3, 1);
    for (std::uint32_t k = 0; k < 20; ++k) {
      estimator.push(k, InternalBank::step(bank, m, e));
    }
    const MagnitudeEstimate& found = estimator.estimate(Faults{0, 1, 2}, 0);
    ASSERT_EQ(found.status, EstimateStatus::kValid);
    for (std::size_t j = 0; j < 3; ++j) {
      EXPECT_NEAR(found.value[j], m[static_cast<Index>(j)], 1e-9) << j;
    }
  }
}

TEST(MagnitudeEstimator, ClaimsTheDeviationThatItsErrorsHave) {
  const std::uint64_t seed = test_seed(52);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  const Bank bank = sampled_bank();
  MagnitudeEstimator estimator(bank);
  HouLoop loop(bank);
  loop.sigma = 0.01;
  loop.fault << 2.0, 0.0, 1.0, 0.0;
  constexpr int kRuns = 2000;
  const std::array<double, 2> truth = {2.0, 1.0};
  std::array<double, 2> sum{}, squares{}, claimed{}, normalised{};
  for (int run = 0; run < kRuns; ++run) {
    loop.step(engine, estimator, 55);  // more than a window: runs share no sample
    const MagnitudeEstimate& found = estimator.estimate(Faults{0, 2}, 0);
    ASSERT_EQ(found.status, EstimateStatus::kValid);
    for (std::size_t j = 0; j < 2; ++j) {
      const double error = found.value[j] - truth[j];
      sum[j] += error;
      squares[j] += error * error;
      claimed[j] += found.deviation[j] * found.deviation[j];
      normalised[j] += error * error / (found.deviation[j] * found.deviation[j]);
    }
  }
  for (std::size_t j = 0; j < 2; ++j) {
    const double deviation = std::sqrt(squares[j] / kRuns);
    EXPECT_NEAR(deviation, std::sqrt(claimed[j] / kRuns), 0.1 * deviation);
    EXPECT_LT(std::abs(sum[j] / kRuns), 4.0 * deviation / std::sqrt(kRuns)) << "no bias";
    // χ² of kRuns degrees of freedom over kRuns: mean 1, deviation √(2/kRuns); 4 of those, and the
    // ν/(ν-2) of an estimated variance, ν being some 100.
    EXPECT_NEAR(normalised[j] / kRuns, 1.02, 4.0 * std::sqrt(2.0 / kRuns));
  }
}

TEST(MagnitudeEstimator, ClaimsMoreWhereTheErrorsAreLarger) {
  const Bank bank = sampled_bank();
  std::array<double, 2> deviation{};
  for (std::size_t i = 0; i < 2; ++i) {
    std::mt19937_64 engine(3);
    MagnitudeEstimator estimator(bank);
    HouLoop loop(bank);
    loop.sigma = i == 0 ? 1e-3 : 1e-2;
    loop.step(engine, estimator, 60);
    deviation[i] = estimator.estimate(Faults{1}, 0).deviation[0];
  }
  EXPECT_NEAR(deviation[1] / deviation[0], 10.0, 1e-6) << "the same errors, ten times as large";
}

TEST(MagnitudeEstimator, CountsWhatStandingOutputsHideBetweenTwoStepsOfTheirSignals) {
  const std::uint64_t seed = test_seed(53);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  const Bank bank = sampled_bank();
  const std::array<double, 3> resolution = {1e-2, 2e-3, 0.0};
  MagnitudeEstimator estimator(bank, resolution);
  HouLoop loop(bank);
  loop.fault << 2.0, 0.0, 1.0, 0.0;
  loop.step(engine, estimator, 100);
  constexpr int kRuns = 2000;
  double squares = 0.0, claimed = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    for (std::size_t c = 0; c < 3; ++c) {
      loop.offset[static_cast<Index>(c)] =
          resolution[c] * std::uniform_real_distribution<double>(-0.5, 0.5)(engine);
    }
    loop.step(engine, estimator, 50);
    const MagnitudeEstimate& found = estimator.estimate(Faults{0, 2}, 0);
    squares += (found.value[1] - 1.0) * (found.value[1] - 1.0);
    claimed += found.deviation[1] * found.deviation[1];
  }
  const double deviation = std::sqrt(squares / kRuns);
  EXPECT_GT(deviation, 1e-4) << "the fit cannot know";
  EXPECT_NEAR(deviation, std::sqrt(claimed / kRuns), 0.1 * deviation);
}

TEST(MagnitudeEstimator, DoesNotClaimADeviationItCannotTell) {
  // One output, one filter without memory, one sample: the estimate takes all there is.
  InternalBank random(5);
  Bank bank = random.bank(1, 1);
  bank.decision.window = 1;
  bank.filters.push_back(random.filter(0, 1, 1, 1));
  MagnitudeEstimator estimator(bank);
  std::vector<VectorXd> e = {VectorXd(0)};
  estimator.push(0, InternalBank::step(bank, VectorXd::Constant(1, 3.0), e));
  const MagnitudeEstimate& found = estimator.estimate(Faults{0}, 0);
  ASSERT_EQ(found.status, EstimateStatus::kValid);
  EXPECT_NEAR(found.value[0], 3.0, 1e-12);
  EXPECT_EQ(found.deviation[0], MagnitudeEstimate::kUnknown);
}

TEST(MagnitudeEstimator, HasNoEstimateOfAFaultSeenOnlyInTransients) {
  InternalBank random(6);
  Bank bank = random.bank(2, 2);
  for (int i = 0; i < 3; ++i) {
    ResidualFilter filter = random.filter(2, 1, 2, 2);
    const MatrixXd resolvent = MatrixXd::Identity(2, 2) - filter.F;
    filter.J.col(1) = -filter.M * resolvent.inverse() * filter.L.col(1);  // zero DC gain
    bank.filters.push_back(filter);
  }
  MagnitudeEstimator estimator(bank);
  std::vector<VectorXd> e(3, VectorXd::Zero(2));
  for (std::uint32_t k = 0; k < 50; ++k) {
    estimator.push(k, InternalBank::step(bank, VectorXd::Ones(2), e));
  }
  EXPECT_EQ(estimator.estimate(Faults{1}, 0).status, EstimateStatus::kTransientOnly);
  EXPECT_EQ(estimator.estimate(Faults{0, 1}, 0).status, EstimateStatus::kTransientOnly);
  EXPECT_TRUE(estimator.estimate(Faults{1}, 0).value.empty());
  EXPECT_EQ(estimator.estimate(Faults{0}, 0).status, EstimateStatus::kValid)
      << "what fades is as the past: it does not disturb the other";
  EXPECT_NEAR(estimator.estimate(Faults{0}, 0).value[0], 1.0, 1e-9);
}

TEST(MagnitudeEstimator, HasNoEstimateOfAFaultNoResidualSees) {
  InternalBank random(7);
  Bank bank = random.bank(1, 1);
  bank.filters.push_back(random.filter(2, 1, 1, 1));
  bank.filters[0].L.setZero();
  bank.filters[0].J.setZero();
  MagnitudeEstimator estimator(bank);
  for (std::uint32_t k = 0; k < 50; ++k) {
    estimator.push(k, std::vector<double>{1.0});
  }
  EXPECT_EQ(estimator.estimate(Faults{0}, 0).status, EstimateStatus::kTransientOnly);
}

TEST(MagnitudeEstimator, HasNoEstimateOfFaultsThatLeaveTheSameTraces) {
  // null(B) = (2, 1, -1, -1): of all four of Hou's faults only three combinations are seen.
  std::mt19937_64 engine(1);
  Bank bank = sampled_bank();
  bank.concurrent = 4;
  MagnitudeEstimator estimator(bank);
  HouLoop loop(bank);
  loop.fault << 1.0, 2.0, 3.0, 0.0;
  loop.step(engine, estimator, 60);
  EXPECT_EQ(estimator.estimate(Faults{0, 1, 2, 3}, 0).status, EstimateStatus::kDependent);
  EXPECT_EQ(estimator.estimate(Faults{0, 1, 2}, 0).status, EstimateStatus::kValid);
  EXPECT_NEAR(estimator.estimate(Faults{0, 1, 2}, 0).value[2], 3.0, 1e-9);
}

TEST(MagnitudeEstimator, WaitsUntilTheWindowLiesBehindTheLastCrossing) {
  std::mt19937_64 engine(1);
  const Bank bank = sampled_bank();
  MagnitudeEstimator estimator(bank);
  HouLoop loop(bank);
  loop.step(engine, estimator, 49);
  EXPECT_FALSE(estimator.is_window_behind(0));
  EXPECT_EQ(estimator.estimate(Faults{0}, 0).status, EstimateStatus::kTooFewSamples);
  loop.step(engine, estimator, 1);
  EXPECT_TRUE(estimator.is_window_behind(0));
  EXPECT_FALSE(estimator.is_window_behind(1));
  loop.step(engine, estimator, 150);  // 150 .. 199
  EXPECT_TRUE(estimator.is_window_behind(150));
  EXPECT_FALSE(estimator.is_window_behind(151));
}

TEST(MagnitudeEstimator, StartsTheWindowAgainWhereASampleIsMissing) {
  const Bank bank = sampled_bank();
  const std::vector<double> residual(static_cast<std::size_t>(bank.residual_rows()));
  MagnitudeEstimator estimator(bank);
  std::uint32_t cycle = 4294967260u;  // wraps
  const auto push = [&](int count) {
    for (int i = 0; i < count; ++i) {
      estimator.push(cycle++, residual);
    }
  };
  push(50);
  EXPECT_TRUE(estimator.is_window_behind(4294967260));
  ++cycle;
  push(49);
  EXPECT_FALSE(estimator.is_window_behind(kLongAgo));
  push(1);
  EXPECT_TRUE(estimator.is_window_behind(kLongAgo));
  std::vector<double> broken = residual;
  broken.back() = std::numeric_limits<double>::quiet_NaN();
  estimator.push(cycle++, broken);
  push(49);
  EXPECT_FALSE(estimator.is_window_behind(kLongAgo));
  push(1);
  EXPECT_TRUE(estimator.is_window_behind(kLongAgo));
  estimator.restart();
  EXPECT_FALSE(estimator.is_window_behind(kLongAgo));
}

void expect_delays_of_crossings(const Bank& bank) {
  std::mt19937_64 engine(1);
  for (const double size : {1.1, 2.0, 10.0}) {
    MagnitudeEstimator estimator(bank);
    HouLoop loop(bank);
    loop.step(engine, estimator, 100);
    loop.fault << 0.0, size, 0.8 * size, 0.0;
    std::vector<int> crossed_after(bank.filters.size(), -1);
    for (int t = 0; t < 100; ++t) {
      loop.step(engine, estimator, 1);
      for (std::size_t i = 0; i < bank.filters.size(); ++i) {
        if (crossed_after[i] < 0 && loop.evaluation()[i] > bank.filters[i].threshold) {
          crossed_after[i] = t;
        }
      }
    }
    ASSERT_EQ(estimator.estimate(Faults{1, 2}, 100).status, EstimateStatus::kValid);
    for (std::size_t i = 0; i < bank.filters.size(); ++i) {
      const auto delay = estimator.response_delay(i);
      EXPECT_EQ(delay ? static_cast<int>(*delay) : -1, crossed_after[i]) << i;
    }
  }
}

TEST(MagnitudeEstimator, KnowsHowLongAResidualTakesToCross) {
  expect_delays_of_crossings(sampled_bank());
}

TEST(MagnitudeEstimator, KnowsHowLongAResidualTakesToCrossTheEndOfItsCourse) {
  Bank bank = sampled_bank();
  for (std::size_t i = 0; i < bank.filters.size(); ++i) {
    ResidualFilter& filter = bank.filters[i];
    // The last thresholds are 1.5 times what they were, the first far beyond.
    const Eigen::Vector2d course(100.0, 1.5 * filter.threshold);
    filter.course = ThresholdCourse{MatrixXd::Constant(1, 1, 3.0), 3.0 * course, course};
    filter.evaluation = i % 2 == 0 ? Evaluation::kNorm : Evaluation::kComponent;
    filter.threshold = i % 2 == 0 ? 3.0 * course[1] : 1.0;
  }
  expect_delays_of_crossings(bank);
}

TEST(MagnitudeEstimator, TakesTheLargestBankThatIsMeantToRun) {
  InternalBank random(8);
  Bank bank = random.bank(10, 9);
  bank.concurrent = 3;
  const ResidualFilter filter = random.filter(17, 9, 10, 9);
  bank.filters.assign(120, filter);
  MagnitudeEstimator estimator(bank);
  EXPECT_EQ(estimator.estimate(Faults{0}, 0).status, EstimateStatus::kTooFewSamples);
}

TEST(MagnitudeEstimator, RefusesWhatAHostileFileAsksFor) {
  Bank wide = sampled_bank();
  wide.decision.window = std::numeric_limits<std::uint32_t>::max();
  MagnitudeEstimator of_wide(wide);
  of_wide.push(0, std::vector<double>(static_cast<std::size_t>(wide.residual_rows())));
  EXPECT_EQ(of_wide.estimate(Faults{0}, 0).status, EstimateStatus::kTooLarge);
  EXPECT_FALSE(of_wide.response_delay(0));

  InternalBank random(9);
  Bank deep = random.bank(2, 2);
  deep.decision.window = 1000;
  deep.filters.assign(3, random.filter(512, 2, 2, 2));
  MagnitudeEstimator of_deep(deep);
  EXPECT_EQ(of_deep.estimate(Faults{0}, 0).status, EstimateStatus::kTooLarge);
}

TEST(MagnitudeEstimator, SaysInWordsWhyThereIsNoEstimate) {
  EXPECT_EQ(estimate_status_text(EstimateStatus::kValid), "");
  for (const EstimateStatus status :
       {EstimateStatus::kTooFewSamples, EstimateStatus::kTransientOnly, EstimateStatus::kDependent,
        EstimateStatus::kTooLarge, EstimateStatus::kSettling}) {
    EXPECT_NE(estimate_status_text(status), "");
  }
}

TEST(MagnitudeEstimator, DoesNotTouchTheHeapInAThousandSteps) {
  InternalBank random(10);
  Bank bank = random.bank(4, 3);
  for (const auto& [order, rows] : {std::pair{0, 1}, {1, 1}, {5, 3}, {17, 9}}) {
    bank.filters.push_back(random.filter(order, rows, 4, 3));
  }
  MagnitudeEstimator estimator(bank);
  const std::vector<double> residual(14, 0.25);
  const Faults one = {1}, all = {0, 1, 2, 3};
  int valid = 0;
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) {
    estimator.push(k, residual);
    valid += estimator.estimate(k % 2 == 0 ? one : all, k / 2).status == EstimateStatus::kValid;
    static_cast<void>(estimator.response_delay(k % 4));
    if (k % 400 == 399) {
      estimator.restart();
    }
  }
  const std::uint64_t heap_calls = guard.heap_calls();
  EXPECT_EQ(heap_calls, 0u);
  EXPECT_GT(valid, 500);
}

}  // namespace
}  // namespace faultline

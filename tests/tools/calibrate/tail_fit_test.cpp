#include "tools/calibrate/tail_fit.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <ostream>
#include <random>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using testing::ElementsAre;

const double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(ClusterPeaks, AreTheLargestOfWhatBelongsTogether) {
  const std::vector<double> series = {0, 3, 4, 0, 5, 0, 0, 0, 2, 0, 0, 0, 6, kNaN, 7, 1};
  EXPECT_THAT(cluster_peaks(series, 1.5, 3), ElementsAre(5, 2, 6, 7));
  EXPECT_THAT(cluster_peaks(series, 1.5, 1), ElementsAre(4, 5, 2, 6, 7));
  EXPECT_THAT(cluster_peaks(series, 1.5, 100), ElementsAre(6, 7));
  EXPECT_TRUE(cluster_peaks(series, 7.0, 1).empty());
}

TEST(Decorrelation, IsThatOfAnAutoregression) {
  std::mt19937_64 draw(test_seed(20261211));
  std::normal_distribution<double> normal;
  for (const double phi : {0.0, 0.5, 0.9, 0.98}) {
    std::vector<double> series(400'000);
    double x = 0.0;
    for (double& value : series) value = x = phi * x + normal(draw);
    const double expected = phi == 0.0 ? 1.0 : std::log(0.05) / std::log(phi);
    const auto lag = static_cast<double>(decorrelation(series));
    EXPECT_GE(lag, 0.85 * expected) << phi;
    EXPECT_LE(lag, 1.3 * expected + 1.0) << phi;
  }
}

// Peaks that are the quantiles of a generalised Pareto distribution.
TEST(FitTail, FindsTheTailItWasMadeOf) {
  for (const double shape : {-0.3, 0.0, 0.2}) {
    // 40,000 samples of which one in 100 is a peak; the rest is zero.
    std::mt19937_64 draw(test_seed(20261212));
    std::vector<double> series(40'000);
    for (std::size_t k = 0; k < series.size(); ++k) series[k] = -1e-9 * static_cast<double>(k % 97);
    constexpr int kPeaks = 400;
    for (int i = 0; i < kPeaks; ++i) {
      const double p = (i + 0.5) / kPeaks;
      series[static_cast<std::size_t>(100 * i + 50)] =
          1.0 + (shape == 0.0 ? -std::log(p) : (std::pow(p, -shape) - 1.0) / shape);
    }
    const auto fit = fit_tail(series, 1, 399);
    ASSERT_TRUE(fit) << shape;
    EXPECT_NEAR(fit->shape, shape, 0.03);
    EXPECT_NEAR(fit->scale, 1.0, 0.03);
    EXPECT_NEAR(fit->rate(fit->threshold(1e-4)), 1e-4, 1e-9);
    EXPECT_NEAR(fit->rate(fit->level), static_cast<double>(fit->clusters) / 40'000.0, 1e-9);
  }
}

TEST(FitTail, NeedsEnoughPeaks) {
  std::mt19937_64 draw(test_seed(20261213));
  std::normal_distribution<double> normal;
  std::vector<double> series(1999);
  for (double& value : series) value = normal(draw);
  EXPECT_FALSE(fit_tail(series, 1));
  series.resize(2400);
  for (double& value : series) value = normal(draw);
  EXPECT_TRUE(fit_tail(series, 1));
  EXPECT_FALSE(fit_tail(series, 2));
}

TEST(SameRateProbability, IsThatOfTheBinomial) {
  EXPECT_NEAR(same_rate_probability(5, 1.0, 5, 1.0), 1.0, 1e-12);
  // 2 · (1 + 10) / 2^10
  EXPECT_NEAR(same_rate_probability(1, 1.0, 9, 1.0), 2.0 * 11.0 / 1024.0, 1e-12);
  EXPECT_NEAR(same_rate_probability(9, 1.0, 1, 1.0), 2.0 * 11.0 / 1024.0, 1e-12);
  EXPECT_EQ(same_rate_probability(0, 1.0, 0, 1.0), 1.0);
}

// The claim of a calibration: its 95 % interval holds the true rate in at least 93 of 100
// repetitions. The true rate at the threshold is counted in a record a thousand times as long, cut
// off where it has been exceeded often enough.
struct NoiseCase {
  std::string name;
  double phi;   // of the autoregression
  double tail;  // degrees of freedom of Student's t; 0: Gaussian
  std::size_t samples;
  double alarms;  // expected in the record, at the threshold that is asked for
};

void PrintTo(const NoiseCase& one, std::ostream* out) { *out << one.name; }

class Coverage : public testing::TestWithParam<NoiseCase> {};

TEST_P(Coverage, HoldsTheTrueRate) {
  const NoiseCase& one = GetParam();
  const std::uint64_t seed = test_seed(20261214);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 draw(seed);
  std::normal_distribution<double> normal;
  std::student_t_distribution<double> student(one.tail > 0.0 ? one.tail : 1.0);
  const auto noise = [&] { return one.tail > 0.0 ? student(draw) : normal(draw); };
  double x = 0.0;
  const auto next = [&] { return std::abs(x = one.phi * x + noise()); };
  // Peaks of one long record above every level, once: the truth for every threshold.
  const std::size_t gap =
      one.phi == 0.0 ? 1 : static_cast<std::size_t>(std::ceil(std::log(0.05) / std::log(one.phi)));
  constexpr std::size_t kTruth = 60'000'000;
  std::vector<double> truth;
  double lowest = 0.0;
  {
    // A level that one in 2000 samples exceeds is low enough for every threshold below.
    std::vector<double> sample(200'000);
    for (double& value : sample) value = next();
    std::nth_element(sample.begin(), sample.end() - 100, sample.end());
    lowest = *(sample.end() - 100);
    std::size_t quiet = gap;
    for (std::size_t k = 0; k < kTruth; ++k) {
      const double value = next();
      if (value <= lowest) {
        ++quiet;
        continue;
      }
      if (quiet >= gap) {
        truth.push_back(value);
      } else {
        truth.back() = std::max(truth.back(), value);
      }
      quiet = 0;
    }
    std::sort(truth.begin(), truth.end());
  }
  constexpr int kRepetitions = 100;
  int held = 0;
  for (int i = 0; i < kRepetitions; ++i) {
    std::vector<double> series(one.samples);
    for (double& value : series) value = next();
    const auto fit = fit_tail(series, gap);
    ASSERT_TRUE(fit);
    const double threshold = fit->threshold(one.alarms / static_cast<double>(one.samples));
    ASSERT_GT(threshold, lowest);
    const auto beyond = truth.end() - std::upper_bound(truth.begin(), truth.end(), threshold);
    const double rate = static_cast<double>(beyond) / static_cast<double>(kTruth);
    const RateInterval interval = rate_interval(series, gap, threshold);
    ASSERT_LT(interval.low, interval.high);
    held += rate >= interval.low && rate <= interval.high ? 1 : 0;
  }
  EXPECT_GE(held, 93);
  RecordProperty("held", held);
}

INSTANTIATE_TEST_SUITE_P(Noise, Coverage,
                         testing::Values(NoiseCase{"white", 0.0, 0.0, 200'000, 1.0},
                                         NoiseCase{"white_beyond", 0.0, 0.0, 200'000, 0.1},
                                         NoiseCase{"white_short", 0.0, 0.0, 20'000, 0.5},
                                         NoiseCase{"coloured", 0.9, 0.0, 400'000, 0.3},
                                         NoiseCase{"heavy", 0.0, 5.0, 200'000, 0.3}),
                         [](const auto& param) { return param.param.name; });

}  // namespace
}  // namespace faultline

#include "sim/sensor.h"

#include <array>
#include <cmath>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/plant_faults.h"
#include "tests/sim/test_plants.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using enum InjectionKind;

constexpr double kStep_s = 0.1;

/// What sensor y1 reads, one measured value per cycle.
std::vector<double> readings(std::vector<Injection> injections, const std::vector<double>& values,
                             std::int64_t seed = 1) {
  for (Injection& injection : injections) injection.target = "y1";
  const FaultSchedule schedule(fault_targets(double_integrator()), injections, seed);
  PlantFaults faults(schedule, kStep_s);
  std::vector<double> out;
  for (std::size_t k = 0; k < values.size(); ++k) {
    faults.advance(kStep_s * static_cast<double>(k));
    std::array<double, 2> y{values[k], 77.0};
    faults.sense(y);
    EXPECT_EQ(y[1], 77.0) << "the other sensor is well";
    out.push_back(y[0]);
  }
  return out;
}

/// Of cycle k.
double in_cycle(const std::vector<double>& values, int k) {
  return values.at(static_cast<std::size_t>(k));
}

TEST(Sensor, HasGainThenBias) {
  EXPECT_THAT(readings({{.kind = kBias, .value = 1.0, .at_s = 0.1},
                        {.kind = kGain, .value = 2.0, .at_s = 0.1}},
                       {5, 5}),
              ElementsAre(5, 11));
}

TEST(Sensor, Drifts) {
  const std::vector<double> out =
      readings({{.kind = kDrift, .value = -2.0, .at_s = 0.1, .until_s = 0.3}}, {1, 1, 1, 1});
  EXPECT_NEAR(out[1], 1.0, 1e-12);
  EXPECT_NEAR(out[2], 1.0 - 2.0 * 0.1, 1e-12);
  EXPECT_EQ(out[3], 1.0);
}

TEST(Sensor, SticksAtItsLastReadingOrAtAValue) {
  EXPECT_THAT(readings({{.kind = kStuck, .at_s = 0.2, .until_s = 0.4}}, {1, 2, 3, 4, 5}),
              ElementsAre(1, 2, 2, 2, 5));
  EXPECT_THAT(readings({{.kind = kStuck, .value = 9.0, .at_s = 0.1}}, {1, 2, 3}),
              ElementsAre(1, 9, 9));
  EXPECT_THAT(readings({{.kind = kStuck}}, {1, 2}), ElementsAre(1, 1));
}

TEST(Sensor, ReadsZeroOrItsValueWhereItDropsOut) {
  EXPECT_THAT(readings({{.kind = kDropout, .at_s = 0.1, .period_s = 0.2}}, {1, 2, 3, 4, 5}),
              ElementsAre(1, 0, 3, 0, 5));
  EXPECT_THAT(readings({{.kind = kDropout, .value = -1.0}}, {1}), ElementsAre(-1));
}

TEST(Sensor, RoundsToTheNearestStep) {
  EXPECT_THAT(readings({{.kind = kQuantisation, .value = 0.5}}, {0.2, 0.3, -0.9, 4.25}),
              ElementsAre(0.0, 0.5, -1.0, 4.5));
}

TEST(Sensor, DropsOutWhateverElseItHas) {
  EXPECT_THAT(readings({{.kind = kDropout, .at_s = 0.1}, {.kind = kBias, .value = 3.0}}, {1, 2}),
              ElementsAre(4, 0));
}

// Mean, deviation and the share within one deviation, within four standard errors of theirs.
TEST(Sensor, IsNoisyByTheNormalDistribution) {
  constexpr int kCount = 20000;
  constexpr double kSigma = 0.25;
  const std::vector<double> out =
      readings({{.kind = kNoise, .value = kSigma}}, std::vector<double>(kCount, 0.0));
  double sum = 0.0, squares = 0.0, product = 0.0;
  int within = 0;
  for (int k = 0; k < kCount; ++k) {
    sum += in_cycle(out, k);
    squares += in_cycle(out, k) * in_cycle(out, k);
    product += k > 0 ? in_cycle(out, k) * in_cycle(out, k - 1) : 0.0;
    if (std::abs(in_cycle(out, k)) < kSigma) ++within;
  }
  const double root = std::sqrt(kCount);
  EXPECT_NEAR(sum / kCount, 0.0, 4.0 * kSigma / root);
  EXPECT_NEAR(squares / kCount, kSigma * kSigma, 4.0 * std::sqrt(2.0) * kSigma * kSigma / root);
  EXPECT_NEAR(product / kCount, 0.0, 4.0 * kSigma * kSigma / root) << "one cycle and the next";
  EXPECT_NEAR(within / double{kCount}, std::erf(std::sqrt(0.5)), 4.0 * 0.47 / root);
}

TEST(Sensor, RepeatsItsNoiseWithTheSeedAndHasAnotherWithAnother) {
  const std::vector<Injection> noise{{.kind = kNoise, .value = 1.0}};
  const std::vector<double> zeros(100, 0.0);
  EXPECT_EQ(readings(noise, zeros, 5), readings(noise, zeros, 5));
  EXPECT_NE(readings(noise, zeros, 5), readings(noise, zeros, 6));
}

// Two of the same size are two sources.
TEST(Sensor, HasNoiseOfItsOwnFromEachEntry) {
  const std::vector<double> zeros(10, 0.0);
  const Injection noise{.kind = kNoise, .value = 1.0};
  const std::vector<double> one = readings({noise}, zeros), two = readings({noise, noise}, zeros);
  for (int k = 0; k < 10; ++k) EXPECT_NE(in_cycle(two, k), 2.0 * in_cycle(one, k)) << k;
}

}  // namespace
}  // namespace faultline

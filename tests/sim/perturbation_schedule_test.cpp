#include "sim/perturbation_schedule.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/fault_schedule.h"
#include "tests/sim/test_plants.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kT_s = 0.01;
constexpr std::int64_t kSeed = 7;

// Disturbance wind, bounded by 0.1; noise hum, by 0.2, and hiss, not.
PlantModel plant() { return scalar_plant(0.0, 1.0, {.kind = FunctionKind::kSin}); }

std::vector<ActivePerturbations> run(PerturbationSchedule schedule, int samples) {
  std::vector<ActivePerturbations> acted;
  ActivePerturbations acting = schedule.none();
  for (int k = 0; k < samples; ++k) {
    schedule.advance(k * kT_s, acting);
    acted.push_back(acting);
  }
  return acted;
}

std::vector<double> winds(const std::vector<Perturbation>& disturbances,
                          const std::vector<Perturbation>& noises = {}, std::int64_t seed = kSeed,
                          int samples = 100) {
  std::vector<double> values;
  for (const ActivePerturbations& acting : run({plant(), disturbances, noises, seed}, samples)) {
    values.push_back(acting.disturbance[0]);
  }
  return values;
}

ScheduleError refusal(const std::vector<Perturbation>& disturbances,
                      const std::vector<Perturbation>& noises, const PlantModel& model = plant()) {
  try {
    const PerturbationSchedule schedule(model, disturbances, noises, kSeed);
  } catch (const ScheduleError& error) {
    return error;
  }
  return {0, "nothing", "was refused"};
}

TEST(PerturbationSchedule, SaysThatNothingActsWhereNothingIsAskedFor) {
  PerturbationSchedule schedule(plant(), {}, {}, kSeed);
  ActivePerturbations acting = schedule.none();
  EXPECT_EQ(acting.disturbance.size(), 0);
  EXPECT_EQ(acting.noise.size(), 0);
  schedule.advance(0.0, acting);
  EXPECT_EQ(acting.noise.size(), 0);
}

TEST(PerturbationSchedule, DrawsUniformNumbersWithinTheBoundOfThePlantFile) {
  constexpr int kSamples = 100'000;
  const std::vector<ActivePerturbations> acted =
      run({plant(), {{.target = "wind"}}, {{.target = "hum"}}, kSeed}, kSamples);
  double sum = 0.0, squares = 0.0, neighbours = 0.0, products = 0.0, before = 0.0, largest = 0.0;
  for (const ActivePerturbations& acting : acted) {
    const double d = acting.disturbance[0] / 0.1;
    const double w = acting.noise[0] / 0.2;
    largest = std::max({largest, std::abs(d), std::abs(w)});
    sum += d;
    squares += d * d;
    neighbours += d * before;
    products += d * w;
    before = d;
    ASSERT_EQ(acting.noise[1], 0.0) << "nobody asked for hiss";
  }
  EXPECT_LE(largest, 1.0);
  EXPECT_GT(largest, 0.9999);
  // Of N uniform numbers in [-1, 1) the mean deviates by 1/√(3N), the mean square by √(4/45N), a
  // mean product of independent ones by 1/(3√N); five deviations.
  const double root = std::sqrt(static_cast<double>(kSamples));
  EXPECT_NEAR(sum / kSamples, 0.0, 5.0 / (std::sqrt(3.0) * root));
  EXPECT_NEAR(squares / kSamples, 1.0 / 3.0, 5.0 * std::sqrt(4.0 / 45.0) / root);
  EXPECT_NEAR(neighbours / kSamples, 0.0, 5.0 / (3.0 * root));
  EXPECT_NEAR(products / kSamples, 0.0, 5.0 / (3.0 * root));
}

// The numbers come from an independent implementation of the recipe (FNV-1a of the stream's name,
// seed by the golden ratio, splitmix64's finaliser, MT19937-64): a seed means the same everywhere.
TEST(PerturbationSchedule, MeansTheSameBySeedEverywhere) {
  PlantModel model = plant();
  model.disturbances[0].name = "zd1";
  model.noises[0].name = "noise1";
  const std::vector<ActivePerturbations> acted =
      run({model, {{.target = "zd1", .size = 1.0}}, {{.target = "noise1", .size = 1.0}}, 7}, 3);
  const std::vector<double> disturbance{-0.6802506548470939, 0.642662692312669, -0.877788231433151};
  const std::vector<double> noise{-0.1771701875721322, -0.9749376809575763, 0.2540937151890854};
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(acted[k].disturbance[0], disturbance[k]);
    EXPECT_EQ(acted[k].noise[0], noise[k]);
  }
}

TEST(PerturbationSchedule, RepeatsWithItsSeedAndDiffersWithAnother) {
  const std::vector<Perturbation> wind{{.target = "wind"}};
  EXPECT_EQ(winds(wind), winds(wind));
  EXPECT_NE(winds(wind), winds(wind, {}, kSeed + 1));
  EXPECT_NE(winds(wind, {}, -1), winds(wind, {}, 1));
}

TEST(PerturbationSchedule, LetsNoSourceChangeAnother) {
  const std::vector<double> alone = winds({{.target = "wind"}});
  EXPECT_EQ(winds({{.target = "all"}}), alone);
  EXPECT_EQ(winds({{.target = "wind"}}, {{.target = "hum"}, {.target = "hiss", .size = 1.0}}),
            alone);
  PlantModel more = plant();
  more.disturbances.insert(more.disturbances.begin(), {.name = "rain",
                                                       .state = Eigen::VectorXd::Ones(1),
                                                       .output = Eigen::VectorXd::Zero(1),
                                                       .bound = 1.0});
  const auto acted = run({more, {{.target = "all"}}, {}, kSeed}, 100);
  for (std::size_t k = 0; k < acted.size(); ++k) {
    ASSERT_EQ(acted[k].disturbance[1], alone[k]) << k;
    ASSERT_NE(acted[k].disturbance[0], 10.0 * alone[k]) << k;
  }
}

TEST(PerturbationSchedule, DrawsTheSameInASampleWheneverItBeganToAct) {
  const std::vector<double> always = winds({{.target = "wind"}});
  const std::vector<double> partly =
      winds({{.target = "wind", .at_s = 20 * kT_s, .until_s = 50 * kT_s}});
  for (std::size_t k = 0; k < always.size(); ++k) {
    EXPECT_EQ(partly[k], k >= 20 && k < 50 ? always[k] : 0.0) << k;
  }
}

TEST(PerturbationSchedule, AddsUpWhatActsOnOneTarget) {
  const std::vector<double> one = winds({{.target = "wind"}});
  const std::vector<double> shifted = winds(
      {{.target = "wind"}, {.target = "wind", .kind = PerturbationKind::kConstant, .size = -0.5}});
  const std::vector<double> two = winds({{.target = "wind"}, {.target = "wind"}});
  for (std::size_t k = 0; k < one.size(); ++k) {
    EXPECT_EQ(shifted[k], one[k] - 0.5);
    EXPECT_NE(two[k], 2.0 * one[k]) << "the second has a stream of its own";
  }
}

TEST(PerturbationSchedule, SwingsASinusoidFromItsBeginning) {
  const std::vector<double> values = winds({{.target = "wind",
                                             .kind = PerturbationKind::kSinusoid,
                                             .size = 0.08,
                                             .frequency_Hz = 5.0,
                                             .phase_rad = 0.3,
                                             .at_s = 10 * kT_s}});
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double t_s = static_cast<double>(k) * kT_s;
    const double expected = 0.08 * std::sin(2.0 * std::numbers::pi * 5.0 * (t_s - 10 * kT_s) + 0.3);
    EXPECT_NEAR(values[k], k < 10 ? 0.0 : expected, 1e-15) << k;
  }
}

TEST(PerturbationSchedule, TakesItsSizeFromThePlantFileAndWarnsBeyondIt) {
  const PerturbationSchedule within(
      plant(), {{.target = "wind", .kind = PerturbationKind::kConstant}},
      {{.target = "hum", .size = 0.2}, {.target = "hiss", .size = 50.0}}, kSeed);
  EXPECT_THAT(within.warnings(), IsEmpty()) << "hiss has no bound";
  EXPECT_EQ(run(within, 1)[0].disturbance[0], 0.1);
  const PerturbationSchedule beyond(
      plant(), {{.target = "wind"}, {.target = "wind", .size = 0.15}},
      {{.target = "hum", .kind = PerturbationKind::kConstant, .size = -0.3}}, kSeed);
  EXPECT_THAT(beyond.warnings(),
              ElementsAre("disturbance \"wind\" may reach 0.25, beyond its bound 0.1 in the plant "
                          "file: no threshold allows for that",
                          "noise \"hum\" may reach 0.3, beyond its bound 0.2 in the plant file: no "
                          "threshold allows for that"));
}

TEST(PerturbationSchedule, RefusesATargetThatIsNotThere) {
  const ScheduleError unknown = refusal({{.target = "wind"}, {.target = "wend"}}, {});
  EXPECT_EQ(unknown.table(), "disturbance");
  EXPECT_EQ(unknown.entry(), 1U);
  EXPECT_STREQ(unknown.what(),
               "target: found \"wend\", expected \"all\" or a [[disturbance]] of plant \"scalar\" "
               "(wind); did you mean \"wind\"?");
  EXPECT_EQ(refusal({}, {{.target = "wind"}}).table(), "noise") << "a disturbance is no noise";
  PlantModel quiet = plant();
  quiet.disturbances.clear();
  EXPECT_STREQ(refusal({{.target = "all"}}, {}, quiet).what(),
               "target: found \"all\", expected none: plant \"scalar\" has no [[disturbance]]");
}

TEST(PerturbationSchedule, RefusesATargetWithoutABoundUnlessItsSizeIsGiven) {
  const ScheduleError unbounded = refusal({}, {{.target = "all"}});
  EXPECT_EQ(unbounded.table(), "noise");
  EXPECT_EQ(unbounded.field(), "size");
  EXPECT_THAT(unbounded.what(), HasSubstr("\"hiss\" has no bound"));
  EXPECT_STREQ(refusal({}, {{.target = "all", .size = 1.0}}).what(), "nothing: was refused");
}

TEST(PerturbationSchedule, DoesNotAllocateWhileItRuns) {
  PerturbationSchedule schedule(plant(), {{.target = "wind"}}, {{.target = "hum"}}, kSeed);
  ActivePerturbations acting = schedule.none();
  const AllocationGuard guard;
  for (int k = 0; k < 1000; ++k) schedule.advance(k * kT_s, acting);
  EXPECT_EQ(guard.heap_calls(), 0U);
}

using enum PerturbationKind;

std::shared_ptr<const RecordedSignal> record() {
  return std::make_shared<const RecordedSignal>("t_s,wind,gust\n0,1,-7\n0.02,3,1\n0.04,3,1\n",
                                                "w.csv");
}

TEST(PerturbationSchedule, DrawsNormalNumbersOfTheDeviationAskedFor) {
  constexpr int kCount = 20000;
  const std::vector<double> values =
      winds({{.target = "wind", .kind = kGaussian, .sigma = 0.5}}, {}, kSeed, kCount);
  double sum = 0.0, squares = 0.0, fourths = 0.0;
  for (const double value : values) {
    sum += value;
    squares += value * value;
    fourths += std::pow(value, 4);
  }
  // Four standard errors of mean, variance and fourth moment of a normal distribution.
  const double root = std::sqrt(kCount);
  EXPECT_NEAR(sum / kCount, 0.0, 4.0 * 0.5 / root);
  EXPECT_NEAR(squares / kCount, 0.25, 4.0 * std::sqrt(2.0) * 0.25 / root);
  EXPECT_NEAR(fourths / kCount, 3.0 * 0.0625, 4.0 * std::sqrt(96.0) * 0.0625 / root);
}

TEST(PerturbationSchedule, TakesTheDeviationFromThePlantFileOrAsksForIt) {
  EXPECT_STREQ(refusal({}, {{.target = "hiss", .kind = kGaussian}}).what(), "nothing: was refused");
  const ScheduleError error = refusal({}, {{.target = "hum", .kind = kGaussian}});
  EXPECT_EQ(error.field(), "sigma");
  EXPECT_THAT(error.what(), HasSubstr("\"hum\" has no sigma"));
}

TEST(PerturbationSchedule, WarnsOfNormalNumbersWhereThePlantFileHasABound) {
  const PerturbationSchedule schedule(
      plant(), {},
      {{.target = "hum", .kind = kGaussian, .sigma = 0.01}, {.target = "hiss", .kind = kGaussian}},
      kSeed);
  EXPECT_THAT(
      schedule.warnings(),
      ElementsAre(HasSubstr("noise \"hum\" is normally distributed, beyond its bound 0.2")));
}

TEST(PerturbationSchedule, FollowsARecordFromItsBeginning) {
  const std::vector<double> values =
      winds({{.target = "wind", .kind = kRecorded, .size = 2.0, .record = record(), .at_s = 0.05}},
            {}, kSeed, 12);
  for (int k = 0; k < 12; ++k) {
    const double expected = k < 5 ? 0.0 : 2.0 * std::min(3.0, 1.0 + (k - 5));
    EXPECT_NEAR(values[static_cast<std::size_t>(k)], expected, 1e-6) << k;
  }
}

TEST(PerturbationSchedule, WarnsOfARecordBeyondTheBound) {
  const auto warnings = [](double size) {
    return PerturbationSchedule(plant(),
                                {{.target = "wind",
                                  .kind = kRecorded,
                                  .size = size,
                                  .column = "gust",
                                  .record = record()}},
                                {}, kSeed)
        .warnings();
  };
  EXPECT_THAT(warnings(0.1 / 7.0), IsEmpty());
  EXPECT_THAT(warnings(-0.2 / 7.0), ElementsAre(HasSubstr("may reach 0.2")));
}

TEST(PerturbationSchedule, RefusesFrequenciesFromHalfTheSampleRateOn) {
  const auto refused = [](const Perturbation& perturbation) {
    try {
      const PerturbationSchedule schedule(plant(), {perturbation}, {}, kSeed, kT_s);
    } catch (const ScheduleError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(refused({.target = "wind", .kind = kSinusoid, .frequency_Hz = 50.0}),
              HasSubstr("frequency_Hz: found 50, expected less than half the sample rate: 50 Hz"));
  EXPECT_THAT(refused({.target = "wind", .kind = kBandLimited, .sigma = 1.0, .to_Hz = 60.0}),
              HasSubstr("to_Hz: found 60"));
  EXPECT_EQ(refused({.target = "wind", .kind = kBandLimited, .sigma = 1.0, .to_Hz = 49.0}), "");
}

TEST(PerturbationSchedule, DoesNotAllocateWhateverActs) {
  PerturbationSchedule schedule(
      plant(),
      {{.target = "wind", .kind = kGaussian, .sigma = 1.0},
       {.target = "wind", .kind = kBandLimited, .sigma = 1.0, .from_Hz = 1.0, .to_Hz = 3.0},
       {.target = "wind", .kind = kRecorded, .record = record(), .is_repeated = true}},
      {}, kSeed, kT_s);
  ActivePerturbations acting = schedule.none();
  const AllocationGuard guard;
  for (int k = 0; k < 1000; ++k) schedule.advance(k * kT_s, acting);
  EXPECT_EQ(guard.heap_calls(), 0U);
}

}  // namespace
}  // namespace faultline

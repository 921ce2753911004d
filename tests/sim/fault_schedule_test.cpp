#include "sim/fault_schedule.h"

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/sim/test_plants.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(Activity, IsOneFromOnsetToEnd) {
  const Injection injection{.target = "force", .value = 1.0, .at_s = 2.0, .until_s = 3.0};
  EXPECT_EQ(activity(injection, 1.99), 0.0);
  EXPECT_EQ(activity(injection, 2.0), 1.0);
  EXPECT_EQ(activity(injection, 2.99), 1.0);
  EXPECT_EQ(activity(injection, 3.0), 0.0);
}

TEST(Activity, BeginsAtTheCycleThatIsMeantInSpiteOfRounding) {
  const Injection injection{.target = "force", .value = 1.0, .at_s = 0.3};
  EXPECT_EQ(activity(injection, 3 * 0.1 - 1e-16), 1.0);
}

TEST(Activity, RisesLinearlyOverItsRamp) {
  const Injection injection{.target = "force", .value = 1.0, .at_s = 1.0, .ramp_s = 4.0};
  EXPECT_NEAR(activity(injection, 2.0), 0.25, 1e-8);
  EXPECT_EQ(activity(injection, 6.0), 1.0);
}

TEST(Activity, OfAnIntermittentFaultIsOnInTheFirstHalfOfEachPeriod) {
  const Injection injection{.target = "force", .value = 1.0, .at_s = 1.0, .period_s = 2.0};
  EXPECT_EQ(activity(injection, 1.5), 1.0);
  EXPECT_EQ(activity(injection, 2.5), 0.0);
  EXPECT_EQ(activity(injection, 3.5), 1.0);
}

TEST(FaultSchedule, AddsBiasesAndMultipliesGains) {
  const FaultSchedule schedule(
      double_integrator(),
      {{.target = "force", .value = 2.0, .at_s = 0.0},
       {.target = "force", .value = 3.0, .at_s = 0.0},
       {.target = "force", .kind = InjectionKind::kGain, .value = 0.5, .at_s = 0.0},
       {.target = "force", .kind = InjectionKind::kGain, .value = 0.5, .at_s = 0.0},
       {.target = "y2", .value = 7.0, .at_s = 0.0},
       {.target = "leak", .value = 9.0, .at_s = 0.0}});
  ActiveFaults faults = schedule.none();
  schedule.evaluate(1.0, faults);
  EXPECT_EQ(faults.input_bias[0], 5.0);
  EXPECT_EQ(faults.input_gain[0], 0.25);
  EXPECT_EQ(faults.output_bias[1], 7.0);
  EXPECT_EQ(faults.component[0], 9.0);
}

// 0.2 + 0.1 sin(0.1 π (k - 1000)) at 100 Hz.
TEST(FaultSchedule, AddsASinusoidToABias) {
  const FaultSchedule schedule(double_integrator(),
                               {{.target = "force", .value = 0.2, .at_s = 10.0},
                                {.target = "force",
                                 .kind = InjectionKind::kSinusoid,
                                 .value = 0.1,
                                 .at_s = 10.0,
                                 .until_s = 20.0,
                                 .frequency_Hz = 5.0}});
  ActiveFaults faults = schedule.none();
  for (int k = 990; k < 2010; ++k) {
    schedule.evaluate(0.01 * k, faults);
    const double swing = k < 2000 ? 0.1 * std::sin(0.1 * std::numbers::pi * (k - 1000)) : 0.0;
    EXPECT_NEAR(faults.input_bias[0], k < 1000 ? 0.0 : 0.2 + swing, 1e-13) << k;
    EXPECT_EQ(faults.input_gain[0], 1.0);
  }
}

TEST(FaultSchedule, LetsASinusoidBeginInItsPhaseAndGrowOverItsRamp) {
  const Injection injection{.target = "leak",
                            .kind = InjectionKind::kSinusoid,
                            .value = 2.0,
                            .at_s = 1.0,
                            .ramp_s = 4.0,
                            .frequency_Hz = 0.5,
                            .phase_rad = 0.5};
  EXPECT_EQ(injected_value(injection, 0.9), 0.0);
  EXPECT_NEAR(injected_value(injection, 2.0), 0.25 * 2.0 * std::sin(std::numbers::pi + 0.5), 1e-8);
  const FaultSchedule schedule(double_integrator(), {injection});
  ActiveFaults faults = schedule.none();
  schedule.evaluate(2.0, faults);
  EXPECT_EQ(faults.component[0], injected_value(injection, 2.0));
}

TEST(FaultSchedule, ForgetsAFaultThatHasEnded) {
  const FaultSchedule schedule(double_integrator(),
                               {{.target = "force", .value = 2.0, .at_s = 0.0, .until_s = 1.0}});
  ActiveFaults faults = schedule.none();
  schedule.evaluate(0.5, faults);
  EXPECT_EQ(faults.input_bias[0], 2.0);
  schedule.evaluate(1.5, faults);
  EXPECT_EQ(faults.input_bias[0], 0.0);
}

TEST(FaultSchedule, NamesTheFaultsThatAct) {
  const FaultSchedule schedule(double_integrator(),
                               {{.target = "y2", .value = 1.0, .at_s = 1.0},
                                {.target = "force", .value = 1.0, .at_s = 1.0},
                                {.target = "force", .value = 1.0, .at_s = 2.0}});
  EXPECT_THAT(schedule.active_names(0.5), IsEmpty());
  EXPECT_THAT(schedule.active_names(2.5), ElementsAre("force", "y2"));
}

TEST(FaultSchedule, RefusesAnUnknownTargetAndSuggestsTheNearest) {
  try {
    const FaultSchedule schedule(double_integrator(), {{.target = "y2"}, {.target = "forse"}});
    FAIL() << "expected a ScheduleError";
  } catch (const ScheduleError& error) {
    EXPECT_EQ(error.entry(), 1U);
    EXPECT_THAT(error.what(), HasSubstr("forse"));
    EXPECT_THAT(error.what(), HasSubstr("did you mean \"force\"?"));
  }
}

TEST(FaultSchedule, RefusesAGainOnAComponentFault) {
  EXPECT_THROW(FaultSchedule(double_integrator(),
                             {{.target = "leak", .kind = InjectionKind::kGain, .value = 0.5}}),
               ScheduleError);
}

}  // namespace
}  // namespace faultline

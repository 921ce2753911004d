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
    const FaultSchedule schedule(
        double_integrator(), {{.target = "y2", .value = 1.0}, {.target = "forse", .value = 1.0}});
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

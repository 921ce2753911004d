#include "sim/fault_schedule.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

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

using enum InjectionKind;

/// Everything there is to break, on a run of 10 ms cycles.
FaultTargets everything() {
  FaultTargets targets = fault_targets(double_integrator());
  targets.sample_time_s = 0.01;
  targets.components = {{.name = "leak", .nominal = 0.0}, {.name = "mass", .nominal = 2.0}};
  targets.messages = {{.name = "Position", .has_crc = true, .has_counter = true, .length = 8},
                      {.name = "Speed", .length = 12},
                      {.name = "Command", .is_command = true, .has_crc = true, .length = 6}};
  return targets;
}

/// What is said of the last of some entries; "" if it is taken.
std::string refusal(const std::vector<Injection>& injections) {
  try {
    const FaultSchedule schedule(everything(), injections, 1);
  } catch (const ScheduleError& error) {
    EXPECT_EQ(error.entry(), injections.size() - 1) << "entry that is wrong";
    return error.what();
  }
  return "";
}
std::string refusal(const Injection& injection) { return refusal(std::vector{injection}); }

/// An entry of each kind as it can be.
std::vector<Injection> sound_entries() {
  return {{.target = "force", .kind = kBias, .value = 1.0},
          {.target = "mass", .kind = kGain, .value = 0.5},
          {.target = "y1", .kind = kSinusoid, .value = 1.0, .frequency_Hz = 1.0},
          {.target = "y2", .kind = kStuck},
          {.target = "leak", .kind = kDrift, .value = 0.1},
          {.target = "force", .kind = kDeadZone, .value = 0.1},
          {.target = "force", .kind = kSlow, .value = 0.1},
          {.target = "force", .kind = kHardOver, .value = -1.0},
          {.target = "y1", .kind = kNoise, .value = 0.1},
          {.target = "y1", .kind = kDropout},
          {.target = "y1", .kind = kQuantisation, .value = 0.1},
          {.target = "force", .kind = kFrozen},
          {.target = "y1", .kind = kOffset, .value = 0.1},
          {.target = "y1", .kind = kSwapped, .with = "y2"},
          {.target = "Speed", .kind = kDropped},
          {.target = "Speed", .kind = kDelayed, .value = 3.0},
          {.target = "Speed", .kind = kDuplicated},
          {.target = "Speed", .kind = kReordered},
          {.target = "Speed", .kind = kCorrupted, .value = 96.0},
          {.target = "Command", .kind = kWrongCrc},
          {.target = "Position", .kind = kFrozenCounter},
          {.target = "Speed", .kind = kWrongDlc, .value = 16.0},
          {.target = "0x1A5", .kind = kBabbling},
          {.target = "controller", .kind = kBusOff}};
}

TEST(FaultSchedule, ResolvesAnEntryOfEveryKind) {
  const FaultSchedule schedule(everything(), sound_entries(), 1);
  ASSERT_EQ(schedule.size(), all_injection_kinds().size());
  for (std::size_t i = 0; i < schedule.size(); ++i) {
    EXPECT_EQ(schedule.injection(i).kind, all_injection_kinds()[i]);
    EXPECT_GT(schedule.activity(i, 1.0), 0.0);
  }
  const auto target_of = [&](InjectionKind kind) {
    return schedule.target(static_cast<std::size_t>(kind));
  };
  EXPECT_EQ(target_of(kGain).kind, FaultTargetKind::kComponent);
  EXPECT_EQ(target_of(kGain).index, 1U);
  EXPECT_EQ(target_of(kSwapped).with, 1U);
  EXPECT_EQ(target_of(kDropped).kind, FaultTargetKind::kMessage);
  EXPECT_EQ(target_of(kWrongCrc).index, 2U);
  EXPECT_EQ(target_of(kBabbling).kind, FaultTargetKind::kId);
  EXPECT_EQ(target_of(kBabbling).index, 0x1A5U);
  EXPECT_EQ(target_of(kBusOff).kind, FaultTargetKind::kNode);
  EXPECT_EQ(target_of(kBusOff).index, 1U);
}

TEST(FaultSchedule, SuggestsOnlyWhatTheKindCanSitOn) {
  EXPECT_THAT(refusal({.target = "force", .kind = kNoise, .value = 1.0}),
              HasSubstr("target: found \"force\", expected an output"));
  EXPECT_THAT(refusal({.target = "Sped", .kind = kDropped}),
              HasSubstr("(Position, Speed, Command) with kind = \"dropped\"; did you mean "
                        "\"Speed\"?"));
  EXPECT_THAT(refusal({.target = "y3", .kind = kDropout}), HasSubstr("did you mean \"y1\"?"));
  EXPECT_THAT(refusal({.target = "plont", .kind = kBusOff}), HasSubstr("did you mean \"plant\"?"));
  EXPECT_THAT(refusal({.target = "0x20000000", .kind = kBabbling}), HasSubstr("target: found"));
  EXPECT_THAT(refusal({.target = "y1", .kind = kSwapped, .with = "y1"}),
              HasSubstr("with: found \"y1\", expected another output"));
  EXPECT_THAT(refusal({.target = "force", .kind = kSwapped, .with = "y1"}),
              HasSubstr("expected another input"));
}

TEST(FaultSchedule, RefusesWhatAMessageDoesNotHave) {
  EXPECT_THAT(refusal({.target = "Speed", .kind = kWrongCrc}),
              HasSubstr("found message \"Speed\", which has no checksum"));
  EXPECT_THAT(refusal({.target = "Command", .kind = kFrozenCounter}),
              HasSubstr("no alive counter in the DBC, expected one that has (Position)"));
  EXPECT_THAT(refusal({.target = "Position", .kind = kCorrupted, .value = 65.0}),
              HasSubstr("at most the 64"));
  EXPECT_THAT(refusal({.target = "Position", .kind = kWrongDlc, .value = 8.0}),
              HasSubstr("expected another length"));
  EXPECT_THAT(refusal({.target = "Position", .kind = kWrongDlc, .value = 12.0}),
              HasSubstr("0 to 8"));
  EXPECT_THAT(refusal({.target = "Speed", .kind = kWrongDlc, .value = 13.0}),
              HasSubstr("a length of a frame"));
}

TEST(FaultSchedule, RefusesValuesOutOfRange) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (const InjectionKind kind : {kBias, kGain, kDrift, kDeadZone, kSlow}) {
    EXPECT_THAT(refusal({.target = "force", .kind = kind}), HasSubstr("value: found nothing"));
    EXPECT_THAT(refusal({.target = "force", .kind = kind, .value = kNan}),
                HasSubstr("value: found"));
  }
  for (const InjectionKind kind : {kDeadZone, kSlow}) {
    EXPECT_THAT(refusal({.target = "force", .kind = kind, .value = 0.0}),
                HasSubstr("value: found 0, expected a positive number"));
  }
  EXPECT_THAT(refusal({.target = "force", .kind = kFrozen, .value = 1.0}),
              HasSubstr("expected none with kind = \"frozen\""));
  EXPECT_THAT(refusal({.target = "Speed", .kind = kDelayed, .value = 1.5}),
              HasSubstr("a whole number from 1 to 100 (cycles late)"));
  EXPECT_THAT(refusal({.target = "Speed", .kind = kDuplicated, .value = 0.0}),
              HasSubstr("value: found 0"));
  EXPECT_THAT(refusal({.target = "force", .kind = kHardOver}), HasSubstr("gives no range"));
}

TEST(FaultSchedule, RefusesATimelineThatContradictsItself) {
  const auto with = [](auto change) {
    Injection injection{.target = "force", .value = 1.0, .at_s = 2.0, .until_s = 4.0};
    change(injection);
    return refusal(injection);
  };
  EXPECT_THAT(with([](Injection& i) { i.until_s = 2.0; }), HasSubstr("expected more than at_s"));
  EXPECT_THAT(with([](Injection& i) { i.ramp_s = 2.5; }), HasSubstr("at most the 2 s"));
  EXPECT_THAT(with([](Injection& i) { i.ramp_s = -1; }), HasSubstr("ramp_s: found -1"));
  EXPECT_THAT(with([](Injection& i) { i.spread_s = -1; }), HasSubstr("spread_s: found -1"));
  EXPECT_THAT(with([](Injection& i) { i.period_s = 0.015; }), HasSubstr("at least 0.02 s"));
  EXPECT_EQ(with([](Injection& i) { i.period_s = 0.02; }), "");
  EXPECT_THAT(with([](Injection& i) { i.probability = 0.0; }), HasSubstr("probability: found 0"));
  EXPECT_THAT(with([](Injection& i) { i.probability = 1.1; }), HasSubstr("probability: found 1.1"));
  EXPECT_THAT(with([](Injection& i) { i.kind = kStuck, i.ramp_s = 1; }),
              HasSubstr("ramp_s: found"));
  EXPECT_THAT(with([](Injection& i) { i.kind = kSinusoid; }), HasSubstr("frequency_Hz: found 0"));
  EXPECT_THAT(with([](Injection& i) { i.kind = kSinusoid, i.frequency_Hz = 50.0; }),
              HasSubstr("less than half the sample rate: 50 Hz"));
  EXPECT_THAT(with([](Injection& i) { i.frequency_Hz = 1.0; }), HasSubstr("\"sinusoid\" only"));
  EXPECT_THAT(with([](Injection& i) { i.with = "y1"; }), HasSubstr("\"swapped\" only"));
}

TEST(FaultSchedule, RefusesTwoPlacesForOneChannelAtATime) {
  const Injection stuck{.target = "force", .kind = kStuck, .at_s = 1.0, .until_s = 2.0};
  Injection other{.target = "force", .kind = kHardOver, .value = 1.0, .at_s = 1.5};
  EXPECT_THAT(refusal({stuck, other}),
              HasSubstr("found \"hard_over\" on \"force\" while \"stuck\" of entry 1 may still act "
                        "there (from 1 s until 2 s)"));
  other.at_s = 2.0;
  EXPECT_EQ(refusal({stuck, other}), "");
  Injection late = stuck;
  late.spread_s = 0.5;
  EXPECT_THAT(refusal({late, other}), HasSubstr("until 2.5 s")) << "whatever is drawn";
  const Injection swapped{.target = "y1", .kind = kSwapped, .with = "y2"};
  const Injection back{.target = "y2", .kind = kSwapped, .with = "y1"};
  EXPECT_THAT(refusal({swapped, back}), HasSubstr("may still act there (from 0 s on)"));
}

TEST(FaultSchedule, ChecksWhatIsAddedLaterLikeTheRest) {
  FaultSchedule schedule(everything(), {{.target = "force", .kind = kStuck}}, 1);
  EXPECT_THROW(schedule.add({.target = "force", .kind = kStuck, .value = 1.0}), ScheduleError);
  EXPECT_THROW(schedule.add({.target = "forse", .value = 1.0}), ScheduleError);
  EXPECT_EQ(schedule.size(), 1U);
  schedule.clear("force", 3.0);
  schedule.add({.target = "force", .kind = kStuck, .value = 1.0, .at_s = 3.0});
  EXPECT_EQ(schedule.size(), 2U);
}

TEST(FaultSchedule, MovesAnEntryByWhatItDraws) {
  const Injection injection{
      .target = "force", .value = 1.0, .at_s = 1.0, .until_s = 2.0, .spread_s = 5.0};
  double first = 0.0;
  for (std::int64_t seed = 1; seed <= 20; ++seed) {
    const FaultSchedule schedule(everything(), {injection}, seed);
    const double onset_s = schedule.onset_s(0);
    EXPECT_GE(onset_s, 1.0);
    EXPECT_LT(onset_s, 6.0);
    EXPECT_EQ(schedule.activity(0, onset_s - 0.001), 0.0);
    EXPECT_EQ(schedule.activity(0, onset_s + 0.999), 1.0);
    EXPECT_EQ(schedule.activity(0, onset_s + 1.001), 0.0);
    EXPECT_EQ(FaultSchedule(everything(), {injection}, seed).onset_s(0), onset_s);
    if (seed == 1) first = onset_s;
    if (seed == 2) {
      EXPECT_NE(onset_s, first);
    }
  }
}

TEST(FaultSchedule, SaysWhereAHardOverGoes) {
  FaultTargets targets = everything();
  targets.inputs[0].range = 4.0;
  const FaultSchedule schedule(targets, {{.target = "force", .kind = kHardOver}}, 1);
  EXPECT_EQ(schedule.value(0, 1.0), 3.0 + 4.0);
}

}  // namespace
}  // namespace faultline

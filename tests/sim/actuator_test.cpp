#include "sim/actuator.h"

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
constexpr double kOperating = 3.0;  // of the double integrator's force

FaultTargets targets() {
  FaultTargets made = fault_targets(double_integrator());
  made.inputs[0].range = 7.0;
  return made;
}

/// What the actuator makes of commands, one per cycle.
std::vector<double> answers(std::vector<Injection> injections,
                            const std::vector<double>& commands) {
  for (Injection& injection : injections) injection.target = "force";
  const FaultSchedule schedule(targets(), injections, 1);
  PlantFaults faults(schedule, kStep_s);
  std::vector<double> out;
  for (std::size_t k = 0; k < commands.size(); ++k) {
    faults.advance(kStep_s * static_cast<double>(k));
    std::array<double, 1> u{commands[k]};
    faults.actuate(u, u);
    out.push_back(u[0]);
  }
  return out;
}

/// Of cycle k.
double in_cycle(const std::vector<double>& values, int k) {
  return values.at(static_cast<std::size_t>(k));
}

TEST(Actuator, SticksWhereItWasBeforeTheOnset) {
  EXPECT_THAT(answers({{.kind = kStuck, .at_s = 0.2, .until_s = 0.4}}, {1, 2, 3, 4, 5, 6}),
              ElementsAre(1, 2, 2, 2, 5, 6));
}

TEST(Actuator, SticksWhereItIsInTheFirstCycleOfAll) {
  EXPECT_THAT(answers({{.kind = kStuck}}, {1, 2, 3}), ElementsAre(1, 1, 1));
}

TEST(Actuator, SticksAnewInEachPeriod) {
  EXPECT_THAT(
      answers({{.kind = kStuck, .at_s = 0.2, .period_s = 0.4}}, {1, 2, 3, 4, 5, 6, 7, 8, 9}),
      ElementsAre(1, 2, 2, 2, 5, 6, 6, 6, 9));
}

TEST(Actuator, SticksWhereAnotherFaultHadBroughtIt) {
  EXPECT_THAT(
      answers({{.kind = kBias, .value = 10.0, .until_s = 0.15}, {.kind = kStuck, .at_s = 0.2}},
              {1, 2, 3, 4, 5}),
      ElementsAre(11, 12, 12, 12, 12));
}

TEST(Actuator, SticksAtAValue) {
  EXPECT_THAT(answers({{.kind = kStuck, .value = -1.0, .at_s = 0.1, .until_s = 0.2},
                       {.kind = kStuck, .at_s = 0.2, .until_s = 0.3}},
                      {1, 2, 3, 4}),
              ElementsAre(1, -1, -1, 4));
}

TEST(Actuator, DriftsByItsRateFromItsOnset) {
  const std::vector<double> out =
      answers({{.kind = kDrift, .value = 5.0, .at_s = 0.2}}, {0, 0, 0, 0, 0});
  for (int k = 0; k < 5; ++k)
    EXPECT_NEAR(in_cycle(out, k), 5.0 * std::max(0.0, 0.1 * k - 0.2), 1e-12);
}

TEST(Actuator, DoesNothingInADeadZoneAroundTheOperatingPoint) {
  EXPECT_THAT(
      answers({{.kind = kDeadZone, .value = 1.0}},
              {kOperating, kOperating + 1.0, kOperating - 0.5, kOperating + 3.0, kOperating - 3.0}),
      ElementsAre(kOperating, kOperating, kOperating, kOperating + 2.0, kOperating - 2.0));
}

// τ ż = u - z has the answer u (1 - exp(-t / τ)) to a step, from the cycle on in which it is
// commanded.
TEST(Actuator, AnswersAStepThroughALagExactly) {
  constexpr double kTau_s = 0.35;
  std::vector<double> commands(40, 2.0);
  commands[0] = 0.0;
  const std::vector<double> out = answers({{.kind = kSlow, .value = kTau_s}}, commands);
  EXPECT_EQ(out[0], 0.0);
  for (int k = 1; k < 40; ++k) {
    EXPECT_NEAR(in_cycle(out, k), 2.0 * (1.0 - std::exp(-kStep_s * k / kTau_s)), 1e-12) << k;
  }
}

// What it lacks of the command at the end fades with the same time constant.
TEST(Actuator, DoesNotJumpWhereALagBeginsOrEnds) {
  constexpr double kTau_s = 0.5;
  std::vector<double> commands(400, 1.0);
  for (std::size_t k = 12; k < commands.size(); ++k) commands[k] = 4.0;
  const std::vector<double> out =
      answers({{.kind = kSlow, .value = kTau_s, .at_s = 1.0, .until_s = 1.5}}, commands);
  const double phi = std::exp(-kStep_s / kTau_s);
  for (int k = 1; k < 12; ++k) EXPECT_EQ(in_cycle(out, k), 1.0) << k;
  for (int k = 12; k < 60; ++k) {
    EXPECT_NEAR(4.0 - in_cycle(out, k), phi * (4.0 - in_cycle(out, k - 1)), 1e-12) << k;
  }
  EXPECT_EQ(out.back(), 4.0) << "forgotten in the end";
}

TEST(Actuator, GoesHardOverToAValueOrTheEndOfItsRange) {
  EXPECT_THAT(answers({{.kind = kHardOver, .value = -9.0, .at_s = 0.1, .until_s = 0.2}}, {1, 2, 3}),
              ElementsAre(1, -9, 3));
  EXPECT_THAT(answers({{.kind = kHardOver, .at_s = 0.1}}, {1, 2}), ElementsAre(1, kOperating + 7));
  const std::vector<double> slow =
      answers({{.kind = kHardOver, .value = 5.0, .ramp_s = 0.4}}, {1, 1, 1, 1, 1});
  for (int k = 0; k < 5; ++k) EXPECT_NEAR(in_cycle(slow, k), 1.0 + 0.25 * k * 4.0, 1e-7) << k;
}

TEST(Actuator, TakesItsFaultsInItsOwnOrder) {
  EXPECT_THAT(answers({{.kind = kBias, .value = 10.0},
                       {.kind = kGain, .value = 0.5},
                       {.kind = kDeadZone, .value = 1.0}},
                      {kOperating + 5.0}),
              ElementsAre(0.5 * (kOperating + 4.0) + 10.0));
  EXPECT_THAT(answers({{.kind = kStuck, .value = 7.0}, {.kind = kBias, .value = 10.0}}, {1.0}),
              ElementsAre(7.0));
}

}  // namespace
}  // namespace faultline

#include "sim/plant_faults.h"

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/sim/test_plants.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

double actuated(PlantFaults& faults, double command) {
  std::array<double, 1> u{command};
  faults.actuate(u, u);
  return u[0];
}

TEST(PlantFaults, AddsBiasesAndMultipliesGains) {
  const FaultSchedule schedule(
      double_integrator(),
      {{.target = "force", .value = 2.0, .at_s = 0.0},
       {.target = "force", .value = 3.0, .at_s = 0.0},
       {.target = "force", .kind = InjectionKind::kGain, .value = 0.5, .at_s = 0.0},
       {.target = "force", .kind = InjectionKind::kGain, .value = 0.5, .at_s = 0.0},
       {.target = "y2", .value = 7.0, .at_s = 0.0},
       {.target = "leak", .value = 9.0, .at_s = 0.0}});
  PlantFaults faults(schedule, 0.1);
  faults.advance(1.0);
  EXPECT_EQ(actuated(faults, 8.0), 0.25 * 8.0 + 5.0);
  std::array<double, 2> y{1.0, 2.0};
  faults.sense(y);
  EXPECT_EQ(y[0], 1.0);
  EXPECT_EQ(y[1], 9.0);
  EXPECT_EQ(faults.components()[0], 9.0);
}

// 0.2 + 0.1 sin(0.1 π (k - 1000)) at 100 Hz.
TEST(PlantFaults, AddsASinusoidToABias) {
  const FaultSchedule schedule(double_integrator(),
                               {{.target = "force", .value = 0.2, .at_s = 10.0},
                                {.target = "force",
                                 .kind = InjectionKind::kSinusoid,
                                 .value = 0.1,
                                 .at_s = 10.0,
                                 .until_s = 20.0,
                                 .frequency_Hz = 5.0}});
  PlantFaults faults(schedule, 0.1);
  for (int k = 990; k < 2010; ++k) {
    faults.advance(0.01 * k);
    const double swing = k < 2000 ? 0.1 * std::sin(0.1 * std::numbers::pi * (k - 1000)) : 0.0;
    EXPECT_NEAR(actuated(faults, 0.0), k < 1000 ? 0.0 : 0.2 + swing, 1e-13) << k;
  }
}

TEST(PlantFaults, LetsASinusoidBeginInItsPhaseAndGrowOverItsRamp) {
  const Injection injection{.target = "leak",
                            .kind = InjectionKind::kSinusoid,
                            .value = 2.0,
                            .at_s = 1.0,
                            .ramp_s = 4.0,
                            .frequency_Hz = 0.5,
                            .phase_rad = 0.5};
  EXPECT_EQ(injected_value(injection, activity(injection, 0.9), 0.9), 0.0);
  EXPECT_NEAR(injected_value(injection, activity(injection, 2.0), 2.0),
              0.25 * 2.0 * std::sin(std::numbers::pi + 0.5), 1e-8);
  const FaultSchedule schedule(double_integrator(), {injection});
  PlantFaults faults(schedule, 0.1);
  faults.advance(2.0);
  EXPECT_EQ(faults.components()[0], injected_value(injection, activity(injection, 2.0), 2.0));
}

TEST(PlantFaults, ForgetsAFaultThatHasEnded) {
  const FaultSchedule schedule(double_integrator(),
                               {{.target = "force", .value = 2.0, .at_s = 0.0, .until_s = 1.0}});
  PlantFaults faults(schedule, 0.1);
  faults.advance(0.5);
  EXPECT_EQ(actuated(faults, 0.0), 2.0);
  faults.advance(1.5);
  EXPECT_EQ(actuated(faults, 0.0), 0.0);
}

/// Cycles of 0.1 s in which the actuator does something else than it is told.
std::vector<int> acting_cycles(const FaultSchedule& schedule, int cycles) {
  PlantFaults faults(schedule, 0.1);
  std::vector<int> acting;
  for (int k = 0; k < cycles; ++k) {
    faults.advance(0.1 * k);
    if (actuated(faults, 1.0) != 1.0) acting.push_back(k);
  }
  return acting;
}

// What is skipped while nothing acts must not be missed.
TEST(PlantFaults, MissesNoOnsetAfterQuietCycles) {
  const FaultSchedule schedule(
      double_integrator(),
      {{.target = "force", .value = 1.0, .at_s = 1.0, .until_s = 1.2},
       {.target = "force", .value = 1.0, .at_s = 5.0, .until_s = 5.1},
       {.target = "force", .value = 1.0, .at_s = 7.0, .until_s = 8.0, .period_s = 0.4}});
  EXPECT_THAT(acting_cycles(schedule, 100),
              testing::ElementsAre(10, 11, 50, 70, 71, 74, 75, 78, 79));
}

TEST(PlantFaults, TakesUpWhatIsAddedWhileItRuns) {
  FaultSchedule schedule(double_integrator(), {});
  PlantFaults faults(schedule, 0.1);
  for (int k = 0; k < 5; ++k) faults.advance(0.1 * k);
  schedule.add({.target = "force", .value = 2.0, .at_s = 0.5});
  faults.advance(0.5);
  EXPECT_EQ(actuated(faults, 1.0), 3.0);
  schedule.clear("force", 0.6);
  faults.advance(0.6);
  EXPECT_EQ(actuated(faults, 1.0), 1.0);
}

TEST(PlantFaults, ChangesAParameterByAFactorOfItsNominalValue) {
  FaultTargets targets = fault_targets(double_integrator());
  targets.components = {{.name = "mass", .nominal = 4.0}};
  const FaultSchedule schedule(
      targets,
      {{.target = "mass", .kind = InjectionKind::kGain, .value = 0.75},
       {.target = "mass", .kind = InjectionKind::kDrift, .value = 0.5, .at_s = 1.0}},
      1);
  PlantFaults faults(schedule, 0.1);
  faults.advance(0.0);
  EXPECT_EQ(faults.components()[0], -1.0);
  faults.advance(3.0);
  EXPECT_NEAR(faults.components()[0], -1.0 + 0.5 * 2.0, 1e-12);
}

TEST(PlantFaults, ActsInTheShareOfCyclesThatIsAskedFor) {
  const Injection injection{.target = "force", .value = 1.0, .probability = 0.3};
  const FaultTargets targets = fault_targets(double_integrator());
  const std::vector<int> one = acting_cycles({targets, {injection}, 1}, 10000);
  // Four standard deviations of a binomial distribution.
  EXPECT_NEAR(static_cast<double>(one.size()), 3000.0, 4.0 * std::sqrt(10000 * 0.3 * 0.7));
  EXPECT_EQ(one, acting_cycles({targets, {injection}, 1}, 10000));
  EXPECT_NE(one, acting_cycles({targets, {injection}, 2}, 10000));
}

TEST(PlantFaults, DoesNotAllocateWhateverActs) {
  using enum InjectionKind;
  std::vector<Injection> injections;
  for (const InjectionKind kind : {kBias, kGain, kSinusoid, kDrift, kDeadZone, kSlow, kStuck}) {
    injections.push_back({.target = "force",
                          .kind = kind,
                          .value = 0.5,
                          .period_s = 0.4,
                          .frequency_Hz = kind == kSinusoid ? 1.0 : 0.0});
  }
  for (const InjectionKind kind : {kNoise, kQuantisation, kDropout}) {
    injections.push_back({.target = "y1", .kind = kind, .value = 0.5, .probability = 0.5});
  }
  const FaultSchedule schedule(double_integrator(), injections);
  PlantFaults faults(schedule, 0.1);
  std::array<double, 1> u{};
  std::array<double, 2> y{};
  double sum = 0.0;
  const AllocationGuard guard;
  for (int k = 0; k < 1000; ++k) {
    u[0] = y[0] = k;
    faults.advance(0.1 * k);
    faults.actuate(u, u);
    faults.sense(y);
    sum += u[0] - k;
  }
  EXPECT_EQ(guard.heap_calls(), 0U);
  EXPECT_NE(sum, 0.0);
}

}  // namespace
}  // namespace faultline

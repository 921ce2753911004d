#include "sim/plant_faults.h"

#include <array>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "tests/sim/test_plants.h"

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

}  // namespace
}  // namespace faultline

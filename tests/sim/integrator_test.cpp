#include "sim/integrator.h"

#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using enum IntegrationMethod;

// x'' = -x: (cos t, -sin t) from (1, 0).
const HeldEquations kOscillator{.state_count = 2,
                                .derivative = [](void*, const double* x, double* dx) {
                                  dx[0] = x[1];
                                  dx[1] = -x[0];
                                }};

// A ball on a floor, without loss; g = height.
struct Ball {
  double restitution = 1.0;
  std::vector<double> bounces;  // heights' rates at each
};
constexpr double kGravity_m_s2 = 9.81;
HeldEquations ball_equations() {
  return {.state_count = 3,  // height, its rate, time
          .derivative =
              [](void*, const double* x, double* dx) {
                dx[0] = x[1];
                dx[1] = -kGravity_m_s2;
                dx[2] = 1.0;
              },
          .event_count = 1,
          .events = [](void*, const double* x, double* g) { g[0] = x[0]; },
          .on_event =
              [](void* self, std::size_t, double* x) {
                Ball& ball = *static_cast<Ball*>(self);
                ball.bounces.push_back(x[2]);
                x[1] *= -ball.restitution;
              }};
}

double oscillator_error(const Integration& integration, IntegrationMethod method) {
  constexpr int kSamples = 5;
  const auto integrator = make_integrator(kOscillator, 1.0, method, integration);
  double x[] = {1.0, 0.0};
  for (int k = 0; k < kSamples; ++k) {
    EXPECT_EQ(integrator->advance(nullptr, x).trouble, IntegrationResult::Trouble::kNone);
  }
  return std::hypot(x[0] - std::cos(double{kSamples}), x[1] + std::sin(double{kSamples}));
}

TEST(Integrator, RungeKuttaConvergesWithOrderFour) {
  for (const int substeps : {10, 20, 40}) {
    const double order = std::log2(oscillator_error({.substeps = substeps}, kRk4) /
                                   oscillator_error({.substeps = 2 * substeps}, kRk4));
    EXPECT_NEAR(order, 4.0, 0.1) << substeps;
  }
}

// Step h ~ tolerance^(1/5) and error ~ h^5: the error falls with the tolerance.
TEST(Integrator, DormandPrinceKeepsToItsTolerances) {
  double before = 0.0;
  for (const double tolerance : {1e-4, 1e-6, 1e-8, 1e-10}) {
    const double error = oscillator_error(
        {.absolute_tolerance = tolerance, .relative_tolerance = tolerance}, kDormandPrince);
    EXPECT_LT(error, 30.0 * tolerance);
    if (before > 0.0) {
      EXPECT_NEAR(std::log10(before / error), 2.0, 0.8) << tolerance;
    }
    before = error;
  }
}

// One step per sample, as the tolerances never bind: halving it divides the error by 2^5.
TEST(Integrator, DormandPrinceIsOfOrderFive) {
  const auto error = [](int samples) {
    const double step_s = 1.0 / samples;
    const auto integrator = make_integrator(kOscillator, step_s, kDormandPrince,
                                            {.absolute_tolerance = 1e3, .relative_tolerance = 1e3});
    double x[] = {1.0, 0.0};
    for (int k = 0; k < samples; ++k) integrator->advance(nullptr, x);
    return std::hypot(x[0] - std::cos(1.0), x[1] + std::sin(1.0));
  };
  for (const int samples : {4, 8, 16}) {
    EXPECT_NEAR(std::log2(error(samples) / error(2 * samples)), 5.0, 0.3) << samples;
  }
}

TEST(Integrator, FindsTheTimesAtWhichABallBounces) {
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    Ball ball;
    ball.bounces.reserve(100);
    const auto integrator = make_integrator(ball_equations(), 0.1, method, {});
    double x[] = {1.0, 0.0, 0.0};
    for (int k = 0; k < 100; ++k) {
      ASSERT_EQ(integrator->advance(&ball, x).trouble, IntegrationResult::Trouble::kNone);
    }
    const double fall_s = std::sqrt(2.0 / kGravity_m_s2);
    ASSERT_EQ(ball.bounces.size(), 11U) << integration_method_name(method);
    for (std::size_t i = 0; i < ball.bounces.size(); ++i) {
      EXPECT_NEAR(ball.bounces[i], (2.0 * static_cast<double>(i) + 1.0) * fall_s, 1e-10);
    }
    EXPECT_NEAR(x[0] + x[1] * x[1] / (2.0 * kGravity_m_s2), 1.0, 1e-9) << "energy";
  }
}

TEST(Integrator, GivesUpOnABallThatBouncesTooOften) {
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    Ball ball;
    const auto integrator = make_integrator(ball_equations(), 2.0, method, {});
    constexpr double kHeight_m = 1e-5;
    double x[] = {kHeight_m, 0.0, 0.0};
    const IntegrationResult result = integrator->advance(&ball, x);
    EXPECT_EQ(result.trouble, IntegrationResult::Trouble::kTooManyEvents);
    EXPECT_NEAR(result.into_sample_s, 401.0 * std::sqrt(2.0 * kHeight_m / kGravity_m_s2), 1e-6);
    EXPECT_NE(
        trouble_text(result, {"height", "rate", "t"}).find("height: event 1: more than 200 events"),
        std::string::npos);
  }
}

// Dropped from 1 m it is at rest after sqrt(2/g) (1 + 2e / (1 - e)) seconds, having met the floor
// infinitely often; behind that instant the equations alone would take it through the floor.
struct RestingBall {
  double restitution, floor_m;
  bool is_put_on_floor;
};

TEST(Integrator, GivesUpOnABallThatComesToRest) {
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    for (const double restitution : {0.0, 0.1, 0.5, 0.8, 0.9, 0.97}) {
      for (const double floor_m : {0.0, 1.0, -3.7}) {
        for (const double sample_time_s : {0.01, 0.1, 1.0}) {
          for (const bool is_put_on_floor : {false, true}) {
            RestingBall ball{restitution, floor_m, is_put_on_floor};
            HeldEquations equations = ball_equations();
            equations.events = [](void* self, const double* x, double* g) {
              g[0] = x[0] - static_cast<RestingBall*>(self)->floor_m;
            };
            equations.on_event = [](void* self, std::size_t, double* x) {
              const RestingBall& it = *static_cast<RestingBall*>(self);
              x[1] *= -it.restitution;
              if (it.is_put_on_floor) x[0] = it.floor_m;
            };
            const auto integrator = make_integrator(equations, sample_time_s, method, {});
            const double rest_s =
                std::sqrt(2.0 / kGravity_m_s2) * (1.0 + 2.0 * restitution / (1.0 - restitution));
            double x[] = {floor_m + 1.0, 0.0, 0.0};
            IntegrationResult result;
            int k = -1;
            while (result.trouble == IntegrationResult::Trouble::kNone &&
                   (k + 1) * sample_time_s <= rest_s) {
              result = integrator->advance(&ball, x);
              ++k;
            }
            const std::string which = fmt::format(
                "{}, e = {}, floor {}, every {} s{}", integration_method_name(method), restitution,
                floor_m, sample_time_s, is_put_on_floor ? ", put on it" : "");
            ASSERT_NE(result.trouble, IntegrationResult::Trouble::kNone) << which;
            EXPECT_EQ(trouble_text(result, {"height", "rate", "t"}).rfind("height: event 1", 0), 0U)
                << which;
            // 200 events in one sample end it sooner: 2 sqrt(2/g) e^n / (1 - e) before its rest.
            EXPECT_NEAR(k * sample_time_s + result.into_sample_s, rest_s, 2e-3) << which;
            EXPECT_NEAR(x[0], floor_m, 1e-12) << which;
            if (restitution == 0.0) {
              EXPECT_EQ(result.trouble, IntegrationResult::Trouble::kRest) << which;
            }
          }
        }
      }
    }
  }
}

TEST(Integrator, SaysThatAnEventHasBroughtAStateToRest) {
  EXPECT_EQ(trouble_text({.trouble = IntegrationResult::Trouble::kRest,
                          .index = 1,
                          .event = 2,
                          .into_sample_s = 0.25},
                         {"angle", "height"}),
            "height: event 3 has brought it to rest 0.25 s into the sample, and the equations do "
            "not say what holds it there");
}

// x' = 1 until x is 1, then `slope`: a mode that an event sets. From 0, x(3) = 1 + 2 slope.
TEST(Integrator, GoesOnBehindAnEventThatMerelySwitches) {
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    for (double slope : {0.25, 3.0, 0.0}) {
      const HeldEquations equations{
          .state_count = 2,
          .derivative =
              [](void* self, const double* x, double* dx) {
                dx[0] = x[1] == 0.0 ? 1.0 : *static_cast<double*>(self);
                dx[1] = 0.0;
              },
          .event_count = 1,
          .events = [](void*, const double* x, double* g) { g[0] = x[0] - 1.0; },
          .on_event = [](void*, std::size_t, double* x) { x[1] = 1.0; }};
      const auto integrator = make_integrator(equations, 0.3, method, {});
      double x[] = {0.0, 0.0};
      for (int k = 0; k < 10; ++k) {
        ASSERT_EQ(integrator->advance(&slope, x).trouble, IntegrationResult::Trouble::kNone)
            << slope;
      }
      EXPECT_NEAR(x[0], 1.0 + 2.0 * slope, 1e-9) << integration_method_name(method);
    }
  }
}

// x' = 1 below 1, `slope` above, and on_event changes nothing: what the step that finds the event
// saw behind it spoils that step alone.
TEST(Integrator, GoesOnBehindAnEventThatOnlyTheEquationsKnow) {
  constexpr double kSampleTime_s = 0.3;
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    for (double slope : {0.25, 3.0, 0.0}) {
      const HeldEquations equations{
          .state_count = 1,
          .derivative = [](void* self, const double* x,
                           double* dx) { dx[0] = x[0] < 1.0 ? 1.0 : *static_cast<double*>(self); },
          .event_count = 1,
          .events = [](void*, const double* x, double* g) { g[0] = x[0] - 1.0; },
          .on_event = [](void*, std::size_t, double*) {}};
      const auto integrator = make_integrator(equations, kSampleTime_s, method, {.substeps = 100});
      double x[] = {0.0};
      for (int k = 0; k < 10; ++k) {
        ASSERT_EQ(integrator->advance(&slope, x).trouble, IntegrationResult::Trouble::kNone)
            << slope;
      }
      EXPECT_NEAR(x[0], 1.0 + 2.0 * slope, std::abs(slope - 1.0) * kSampleTime_s / 100)
          << integration_method_name(method);
    }
  }
}

// A heater with hysteresis: T' = heater 20 - T, heater off at 12, on at 8. Warming from 8 to 12
// takes ln(12 / 8) seconds, cooling from 12 to 8 as long.
TEST(Integrator, GoesOnBehindAnEventThatTurnsAPlantBack) {
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    const HeldEquations equations{.state_count = 3,  // temperature, heater, switchings
                                  .derivative =
                                      [](void*, const double* x, double* dx) {
                                        dx[0] = 20.0 * x[1] - x[0];
                                        dx[1] = dx[2] = 0.0;
                                      },
                                  .event_count = 2,
                                  .events =
                                      [](void*, const double* x, double* g) {
                                        g[0] = x[0] - 12.0;
                                        g[1] = x[0] - 8.0;
                                      },
                                  .on_event =
                                      [](void*, std::size_t event, double* x) {
                                        if ((event == 0) != (x[1] == 1.0)) return;
                                        x[1] = event == 0 ? 0.0 : 1.0;
                                        x[2] += 1.0;
                                      }};
    const auto integrator = make_integrator(equations, 0.05, method, {});
    double x[] = {10.0, 1.0, 0.0};
    constexpr int kSamples = 2000;  // 100 s
    for (int k = 0; k < kSamples; ++k) {
      ASSERT_EQ(integrator->advance(nullptr, x).trouble, IntegrationResult::Trouble::kNone) << k;
      ASSERT_GT(x[0], 8.0 - 1e-9);
      ASSERT_LT(x[0], 12.0 + 1e-9);
    }
    const double first_s = std::log(10.0 / 8.0);
    EXPECT_EQ(x[2], 1.0 + std::floor((100.0 - first_s) / std::log(1.5)));
  }
}

// What holds a state where an event has stopped it is a state of the plant's own: a door that
// latches.
TEST(Integrator, StaysWhereAnEventHasLatchedIt) {
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    const HeldEquations equations{.state_count = 3,  // angle, rate, latch
                                  .derivative =
                                      [](void*, const double* x, double* dx) {
                                        dx[0] = x[1];
                                        dx[1] = x[2] == 1.0 ? 0.0 : -1.0;
                                        dx[2] = 0.0;
                                      },
                                  .event_count = 1,
                                  .events = [](void*, const double* x, double* g) { g[0] = x[0]; },
                                  .on_event =
                                      [](void*, std::size_t, double* x) {
                                        x[1] = 0.0;
                                        x[2] = 1.0;
                                      }};
    const auto integrator = make_integrator(equations, 0.3, method, {});
    double x[] = {0.5, 0.0, 0.0};
    for (int k = 0; k < 100; ++k) {
      ASSERT_EQ(integrator->advance(nullptr, x).trouble, IntegrationResult::Trouble::kNone) << k;
    }
    EXPECT_NEAR(x[0], 0.0, 1e-12);
    EXPECT_EQ(x[2], 1.0);
  }
}

// x' = x²: from 1 it is infinite at t = 1.
TEST(Integrator, NamesTheStateWhoseStepsBecomeTooSmall) {
  const HeldEquations equations{
      .state_count = 1,
      .derivative = [](void*, const double* x, double* dx) { dx[0] = x[0] * x[0]; }};
  const auto integrator = make_integrator(equations, 2.0, kDormandPrince, {});
  double x[] = {1.0};
  const IntegrationResult result = integrator->advance(nullptr, x);
  EXPECT_EQ(result.trouble, IntegrationResult::Trouble::kStepsTooSmall);
  EXPECT_NEAR(result.into_sample_s, 1.0, 1e-6);
  EXPECT_EQ(trouble_text(result, {"level1"}).substr(0, 47),
            "level1: the integrator's steps became too small");
}

TEST(Integrator, NeitherAllocatesNorForgetsTheBits) {
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    double ends[2] = {};
    for (double& end : ends) {
      Ball ball;
      ball.bounces.reserve(10'000);
      const auto integrator = make_integrator(ball_equations(), 0.05, method, {});
      double x[] = {1.0, 0.0, 0.0};
      const AllocationGuard guard;
      for (int k = 0; k < 1000; ++k) integrator->advance(&ball, x);
      EXPECT_EQ(guard.heap_calls(), 0U) << integration_method_name(method);
      EXPECT_GT(ball.bounces.size(), 50U);
      end = x[0];
    }
    EXPECT_EQ(ends[0], ends[1]);
  }
}

}  // namespace
}  // namespace faultline

#include "sim/integrator.h"

#include <cmath>
#include <vector>

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
    EXPECT_NE(trouble_text(result, {"height", "rate", "t"}).find("event 1: more than 200 events"),
              std::string::npos);
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

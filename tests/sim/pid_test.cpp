#include "sim/pid.h"

#include <array>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSampleTime_s = 0.1;
constexpr double kStart = 5.0;  // u₀ + v

/// One loop from y to u, reference 2.
PidLaw law_of(const PidLoop& loop) {
  return {.loops = {loop},
          .base = CommandBase(VectorXd::Constant(1, kStart)),
          .reference = Reference(VectorXd::Constant(1, 2.0)),
          .sample_time_s = kSampleTime_s};
}

double command(Pid& pid, std::uint32_t k, double y) {
  std::array<double, 1> u{};
  pid.command(k, std::array<double, 1>{y}, u);
  return u[0];
}

TEST(Pid, IsProportionalWithoutTimes) {
  Pid pid(law_of({.K_p = 3.0}));
  EXPECT_EQ(command(pid, 0, 1.5), kStart + 3.0 * 0.5);
  EXPECT_EQ(command(pid, 1, 2.5), kStart - 3.0 * 0.5);
}

TEST(Pid, BeginsWithoutABumpAndIntegratesTheError) {
  Pid pid(law_of({.K_p = 3.0, .T_i_s = 2.0}));
  EXPECT_EQ(command(pid, 10, 0.5), kStart);
  // e = 1.5 stays: K_p T/T_i e more in each cycle.
  for (std::uint32_t k = 11; k < 20; ++k) {
    EXPECT_NEAR(command(pid, k, 0.5), kStart + 3.0 * kSampleTime_s / 2.0 * 1.5 * (k - 10), 1e-12);
  }
}

TEST(Pid, DifferentiatesTheOutputBehindItsFilter) {
  // y = 2 + 0.7 t: e = -0.7 t, and D comes to -K_p T_d 0.7.
  Pid pid(law_of({.K_p = 3.0, .T_d_s = 0.5, .N = 8.0}));
  double u = 0.0;
  std::uint32_t k = 0;
  for (; k < 200; ++k) u = command(pid, k, 2.0 + 0.7 * kSampleTime_s * k);
  const double proportional = -3.0 * 0.7 * kSampleTime_s * (k - 1);
  EXPECT_NEAR(u - kStart - proportional, -3.0 * 0.5 * 0.7, 1e-9);
  // A step of the output kicks by K_p N at most: backward differences damp it.
  Pid kicked(law_of({.K_p = 3.0, .T_d_s = 0.5, .N = 8.0}));
  static_cast<void>(command(kicked, 0, 2.0));
  EXPECT_NEAR(command(kicked, 1, 3.0) - kStart + 3.0,
              -3.0 * 0.5 * 8.0 / (0.5 + 8.0 * kSampleTime_s), 1e-12);
}

TEST(Pid, DoesNotKickWhenTheReferenceSteps) {
  PidLaw law = law_of({.K_p = 3.0, .T_d_s = 0.5});
  law.reference =
      Reference(VectorXd::Constant(1, 2.0), {{.output = 0, .at_s = 1.0, .value = 4.0}}, 0.1);
  Pid pid(law);
  for (std::uint32_t k = 0; k < 10; ++k) EXPECT_EQ(command(pid, k, 2.0), kStart);
  EXPECT_NEAR(command(pid, 10, 2.0), kStart + 3.0 * 2.0, 1e-12);
}

TEST(Pid, IsItsLinearForm) {
  PidLaw law = law_of({.K_p = -1.5, .T_i_s = 0.8, .T_d_s = 0.3, .N = 5.0});
  law.loops[0].output = 1;
  law.loops.push_back({.output = 0, .input = 1, .K_p = 0.7, .T_d_s = 0.2});
  law.base = CommandBase(VectorXd::Zero(2));
  law.reference = Reference(VectorXd::Zero(2));
  const LinearController form = linear_form(law);
  Pid pid(law);
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  VectorXd xi = VectorXd::Zero(6);
  std::array<double, 2> u{};
  pid.command(0, std::array<double, 2>{0.0, 0.0}, u);
  for (std::uint32_t k = 1; k < 100; ++k) {
    const std::array<double, 2> y{normal(random), normal(random)};
    pid.command(k, y, u);
    const VectorXd dy = Eigen::Vector2d(y[0], y[1]);
    const VectorXd expected = form.H * xi + form.J * dy;
    xi = (form.F * xi + form.G * dy).eval();
    ASSERT_NEAR(u[0], expected[0], 1e-10);
    ASSERT_NEAR(u[1], expected[1], 1e-10);
  }
}

TEST(Pid, MeetsItsReferenceAgainstAConstantDisturbance) {
  // x_k+1 = 0.9 x_k + 0.2 (u_k + d), u delayed by a cycle.
  const PidLaw law = law_of({.K_p = 0.8, .T_i_s = 1.0});
  const DiscretePlant plant{MatrixXd::Constant(1, 1, 0.9), MatrixXd::Constant(1, 1, 0.2),
                            MatrixXd::Ones(1, 1), MatrixXd::Zero(1, 1)};
  const double radius = std::abs(closed_loop_poles(plant, linear_form(law)).front());
  ASSERT_LT(radius, 0.95);
  Pid pid(law);
  double x = 0.0, u = 0.0;
  for (std::uint32_t k = 0; k < 600; ++k) {
    const double x_next = 0.9 * x + 0.2 * (u - 7.0);
    u = command(pid, k, x);
    x = x_next;
  }
  EXPECT_NEAR(x, 2.0, 1e-9);
}

TEST(Pid, LeadsTheIntegralBackFromTheLimit) {
  // At the limit, e = 1 held: what is asked for beyond it settles at K_p e T_t/T_i.
  PidLaw law = law_of({.K_p = 3.0, .T_i_s = 2.0, .T_t_s = 0.5});
  law.base.upper[0] = 6.0;
  Pid pid(law);
  for (std::uint32_t k = 0; k < 500; ++k) EXPECT_LE(command(pid, k, 1.0), 6.0);
  // The error is gone: u = limit + excess - K_p e + K_p T/T_i e - T/T_t excess.
  const double excess = 3.0 * 0.5 / 2.0;
  EXPECT_NEAR(command(pid, 500, 2.0), 6.0 + excess - 3.0 * 1.0, 1e-9);
}

TEST(Pid, HoldsTheIntegralAtTheLimitWhereItClamps) {
  PidLaw law = law_of({.K_p = 3.0, .T_i_s = 2.0, .anti_windup = AntiWindup::kClamping});
  law.base.upper[0] = 6.0;
  Pid pid(law);
  for (std::uint32_t k = 0; k < 500; ++k) EXPECT_LE(command(pid, k, 1.0), 6.0);
  // It stopped in the first cycle that asked for more: within one cycle's growth of the limit.
  const double growth = 3.0 * kSampleTime_s / 2.0;
  const double u = command(pid, 500, 2.0);
  EXPECT_GT(u, 6.0 - 3.0);
  EXPECT_LE(u, 6.0 - 3.0 + growth + 1e-12);
  // And it goes back at once when the error turns.
  const double lower = command(pid, 501, 3.0);
  EXPECT_NEAR(command(pid, 502, 3.0), lower - growth, 1e-12);
}

TEST(Pid, IntegratesOverMissingCycles) {
  Pid pid(law_of({.K_p = 3.0, .T_i_s = 2.0}));
  std::uint32_t k = 0xFFFF'FFFE;  // wraps
  static_cast<void>(command(pid, k, 0.5));
  EXPECT_NEAR(command(pid, k + 40, 0.5), kStart + 3.0 * 40 * kSampleTime_s / 2.0 * 1.5, 1e-12);
}

TEST(Pid, BeginsAnewAfterAJump) {
  Pid pid(law_of({.K_p = 3.0, .T_i_s = 2.0, .T_d_s = 0.3}));
  for (std::uint32_t k = 100; k < 150; ++k) static_cast<void>(command(pid, k, 0.1 * k));
  EXPECT_EQ(command(pid, 0, 1.2), kStart);
  for (std::uint32_t k = 1; k < 50; ++k) static_cast<void>(command(pid, k, 0.1 * k));
  EXPECT_EQ(command(pid, 49 + kMaxMissingCycles + 1, 1.2), kStart);
  EXPECT_NE(command(pid, 49 + 2 * kMaxMissingCycles + 1, 0.2), kStart);
}

TEST(Pid, AnswersARepeatedCycleAsBefore) {
  Pid pid(law_of({.K_p = 3.0, .T_i_s = 2.0}));
  static_cast<void>(command(pid, 0, 1.0));
  const double u = command(pid, 1, 1.1);
  EXPECT_EQ(command(pid, 1, 1.1), u);
}

TEST(Pid, DoesNotAllocateWhileItRuns) {
  PidLaw law = law_of({.K_p = 3.0, .T_i_s = 2.0, .T_d_s = 0.3});
  law.base.upper[0] = 6.0;
  Pid pid(law);
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) {
    static_cast<void>(command(pid, k + (k / 100) * 150, std::sin(0.1 * k)));
  }
  EXPECT_EQ(guard.heap_calls(), 0U);
}

}  // namespace
}  // namespace faultline

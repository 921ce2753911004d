#include "sim/observer_feedback.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "diagnosis/model/riccati.h"
#include "tests/sim/test_plants.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSampleTime_s = 0.1;

/// Of the double integrator about (1, 2), u₀ = 3, whose position alone is measured, and the force
/// a little with it; K and L by unit weights.
ObserverLaw position_law() {
  PlantModel model = double_integrator();
  model.C = (MatrixXd(1, 2) << 1, 0).finished();
  model.D = MatrixXd::Constant(1, 1, 0.125);
  ObserverLaw law;
  law.plant = sample_plant(model, kSampleTime_s);
  law.K = lqr_gain(law.plant.A, law.plant.B, MatrixXd::Identity(2, 2), MatrixXd::Identity(1, 1));
  law.L = kalman_gain(law.plant, {MatrixXd::Identity(2, 2), MatrixXd::Identity(1, 1)},
                      model.state_names);
  law.target = steady_state(law.plant, {0});
  law.base = CommandBase(model.u_operating);
  law.reference = Reference(VectorXd::Constant(1, 1.0));
  law.u_operating = model.u_operating;
  law.y_operating = VectorXd::Constant(1, 1.0);
  return law;
}

/// The plant of a law on a bus: the command of cycle k acts from k+1 on; none yet: u = 0, absolute.
class Loop {
 public:
  Loop(const ObserverLaw& law, VectorXd x) : law_(law), x_(std::move(x)), du_(-law.u_operating) {}

  [[nodiscard]] double measure() const {
    return (law_.plant.C * x_ + law_.plant.D * du_ + law_.y_operating)[0];
  }
  /// One cycle; without `controller` it misses the measurement.
  void step(std::uint32_t k, Controller* controller) {
    const std::array<double, 1> y{measure()};
    const VectorXd x_next = law_.plant.A * x_ + law_.plant.B * du_;
    if (controller != nullptr) {
      std::array<double, 1> u{};
      controller->command(k, y, u);
      du_[0] = u[0] - law_.u_operating[0];
    }
    x_ = x_next;
  }
  [[nodiscard]] const VectorXd& state() const { return x_; }
  [[nodiscard]] double command() const { return (du_ + law_.u_operating)[0]; }

 private:
  const ObserverLaw& law_;
  VectorXd x_, du_;
};

std::vector<double> sizes(const std::vector<std::complex<double>>& poles) {
  std::vector<double> sizes;
  for (const auto& pole : poles) sizes.push_back(std::abs(pole));
  return sizes;
}

TEST(ObserverLaw, HasThePolesOfFeedbackAndObserverInSpiteOfTheDelay) {
  const ObserverLaw law = position_law();
  const std::vector<double> found = sizes(closed_loop_poles(law.plant, linear_form(law)));
  std::vector<double> expected = sizes(poles_of(law.plant.A - law.plant.B * law.K));
  for (const double size : sizes(poles_of(law.plant.A - law.L * law.plant.C))) {
    expected.push_back(size);
  }
  expected.resize(6, 0.0);  // and those of u, acting and as the observer has it: at 0
  std::sort(expected.begin(), expected.end(), std::greater<>());
  ASSERT_EQ(found.size(), expected.size());
  // A double pole at 0 is found to √ε.
  for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 1e-7);
  EXPECT_LT(found.front(), 1.0);
}

TEST(ObserverFeedback, IsItsLinearForm) {
  const ObserverLaw law = position_law();
  const LinearController form = linear_form(law);
  ObserverFeedback feedback(law);
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::array<double, 1> u{};
  // Its first measurement explains itself: ξ = (C⁺ (y - D u), u), u = -u₀.
  std::array<double, 1> y{law.y_operating[0] + normal(random)};
  VectorXd xi(3);
  xi[2] = -law.u_operating[0];
  xi.head(2) = pseudo_inverse(law.plant.C) * ((y[0] - law.y_operating[0]) - 0.125 * xi[2]);
  for (std::uint32_t k = 0; k < 50; ++k) {
    feedback.command(k, y, u);
    const VectorXd dy = VectorXd::Constant(1, y[0] - law.y_operating[0]);
    const VectorXd du = form.H * xi + form.J * dy;
    xi = (form.F * xi + form.G * dy).eval();
    ASSERT_NEAR(u[0], law.u_operating[0] + du[0], 1e-9 * (1.0 + std::abs(du[0])));
    ASSERT_LT((feedback.estimate() - xi.head(2)).norm(), 1e-9 * (1.0 + xi.norm()));
    y[0] = law.y_operating[0] + normal(random);
  }
}

TEST(ObserverFeedback, BringsThePlantToItsOperatingPoint) {
  const ObserverLaw law = position_law();
  Loop loop(law, Eigen::Vector2d(4.0, -2.0));
  ObserverFeedback feedback(law);
  for (std::uint32_t k = 0; k < 300; ++k) loop.step(k, &feedback);
  EXPECT_LT(loop.state().norm(), 1e-8);
}

TEST(ObserverFeedback, HoldsAReferenceExactly) {
  ObserverLaw law = position_law();
  law.reference =
      Reference(VectorXd::Constant(1, 1.0),
                {{.output = 0, .at_s = 5.0, .value = -3.5, .ramp_s = 2.0}}, kSampleTime_s);
  Loop loop(law, Eigen::Vector2d(0.0, 0.0));
  ObserverFeedback feedback(law);
  for (std::uint32_t k = 0; k < 400; ++k) loop.step(k, &feedback);
  EXPECT_NEAR(loop.measure(), -3.5, 1e-8);
}

TEST(ObserverFeedback, KnowsTheStateThoughItsActuatorIsAtItsLimit) {
  ObserverLaw law = position_law();
  law.base.lower[0] = 2.9;
  law.base.upper[0] = 3.1;
  Loop loop(law, Eigen::Vector2d(20.0, 0.0));
  ObserverFeedback feedback(law);
  double furthest = 0.0;
  for (std::uint32_t k = 0; k < 200; ++k) {
    loop.step(k, &feedback);
    EXPECT_LE(std::abs(loop.command() - 3.0), 0.1 + 1e-12);
    furthest = std::max(furthest, std::abs(loop.command() - 3.0));
    if (k <= 100) continue;
    ASSERT_LT((feedback.estimate() - loop.state()).norm(), 1e-6);
  }
  EXPECT_NEAR(furthest, 0.1, 1e-12);
}

TEST(ObserverFeedback, PredictsOverMissingCycles) {
  const ObserverLaw law = position_law();
  Loop loop(law, Eigen::Vector2d(1.0, 0.5));
  ObserverFeedback feedback(law);
  std::uint32_t k = 0xFFFF'FFA0;  // wraps
  for (int i = 0; i < 200; ++i) loop.step(k++, &feedback);
  for (int i = 0; i < kMaxMissingCycles - 1; ++i) loop.step(k++, nullptr);
  loop.step(k++, &feedback);
  EXPECT_LT((feedback.estimate() - loop.state()).norm(), 1e-6);
}

TEST(ObserverFeedback, BeginsAnewWhereThePlantHasRestarted) {
  const ObserverLaw law = position_law();
  ObserverFeedback used(law), fresh(law);
  std::array<double, 1> u_used{}, u_fresh{};
  for (std::uint32_t k = 50; k < 90; ++k) {
    used.command(k, std::array<double, 1>{std::sin(0.3 * k)}, u_used);
  }
  for (std::uint32_t k = 0; k < 20; ++k) {
    const std::array<double, 1> y{1.0 + std::cos(0.2 * k)};
    used.command(k, y, u_used);
    fresh.command(k, y, u_fresh);
    ASSERT_EQ(u_used, u_fresh);
  }
}

TEST(ObserverFeedback, ForgetsItsEstimateAfterALongGap) {
  const ObserverLaw law = position_law();
  ObserverFeedback feedback(law);
  std::array<double, 1> u{};
  for (std::uint32_t k = 0; k < 40; ++k) feedback.command(k, std::array<double, 1>{9.0}, u);
  const double acting = u[0] - law.u_operating[0];
  const std::array<double, 1> y{1.5};
  feedback.command(40 + kMaxMissingCycles, y, u);
  // x̂ = C⁺ (y - y₀ - D u) explains y, so that nothing is left to correct: one prediction.
  const VectorXd x = pseudo_inverse(law.plant.C) * (0.5 - 0.125 * acting);
  const VectorXd expected = law.plant.A * x + law.plant.B * acting;
  EXPECT_LT((feedback.estimate() - expected).norm(), 1e-12);
}

TEST(ObserverFeedback, AnswersARepeatedCycleAsBefore) {
  const ObserverLaw law = position_law();
  ObserverFeedback feedback(law);
  std::array<double, 1> first{}, again{};
  feedback.command(7, std::array<double, 1>{2.0}, first);
  const VectorXd estimate = feedback.estimate();
  feedback.command(7, std::array<double, 1>{2.0}, again);
  EXPECT_EQ(first, again);
  EXPECT_EQ(feedback.estimate(), estimate);
}

TEST(ObserverFeedback, DoesNotAllocateWhileItRuns) {
  ObserverFeedback feedback(position_law());
  std::array<double, 1> u{};
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) {
    feedback.command(k + (k / 100) * 30, std::array<double, 1>{std::sin(0.1 * k)}, u);
  }
  feedback.command(0, std::array<double, 1>{1.0}, u);
  EXPECT_EQ(guard.heap_calls(), 0U);
}

}  // namespace
}  // namespace faultline

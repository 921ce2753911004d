#include "diagnosis/design/uio/observer_filter.h"

#include <cmath>
#include <random>
#include <vector>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "diagnosis/design/uio/component_threshold.h"
#include "diagnosis/design/uio/decoupling.h"
#include "tests/diagnosis/flexible_joint.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// An observer of the Euler robot with some stabilising gain; no inequality was asked.
DesignedObserver some_observer(const PlantModel& plant, const ObserverPlant& sampled,
                               const ObserverTask& task, bool is_decoupling) {
  DesignedObserver observer;
  observer.task = task;
  observer.model = observer_model(plant, joint_request(""), sampled, task, {});
  const ObserverModel& model = observer.model;
  const MatrixXd D = is_decoupling ? MatrixXd(model.M.leftCols(3)) : MatrixXd(model.n(), 0);
  observer.decoupling = decoupling_matrices(split_decouplable(D, model.C).D_1, model.C);
  // Kalman's recursion until it stands, with noise on everything.
  const MatrixXd A = observer.decoupling.S * model.A;
  MatrixXd X = MatrixXd::Identity(model.n(), model.n());
  for (int i = 0; i < 2000; ++i) {
    const MatrixXd innovation = model.C * X * model.C.transpose() + MatrixXd::Identity(3, 3);
    observer.synthesis.gain = A * X * model.C.transpose() * innovation.inverse();
    X = (A - observer.synthesis.gain * model.C) * X * A.transpose() +
        MatrixXd::Identity(model.n(), model.n());
  }
  observer.synthesis.weight = MatrixXd::Identity(3, 3);
  return observer;
}

// The filter in its implementation form, as ResidualFilter's comment has it.
struct FilterRun {
  const ResidualFilter& filter;
  VectorXd v;
  explicit FilterRun(const ResidualFilter& of) : filter(of), v(VectorXd::Zero(of.F.rows())) {}
  VectorXd step(const VectorXd& y, const VectorXd& u) {
    const VectorXd r = filter.M * v - filter.H * y + filter.K * u;
    VectorXd next = filter.F * v - filter.E * y + filter.G * u;
    for (const FilterNonlinearity& term : filter.nonlinearities) {
      const double s = term.a_v.dot(v) + term.a_y.dot(y) + term.a_u.dot(u);
      next += term.W * (evaluate(term.function, s) - term.center * s);
    }
    v = next;
    return r;
  }
};

// The plant of the tests has a D and a slope that is not symmetric, so that every term counts.
PlantModel joint_with_everything() {
  PlantModel plant = flexible_joint_euler();
  plant.D.col(0) << 0.3, -0.2, 0.1;
  plant.faults[0].output = plant.D.col(0);
  plant.nonlinearities[0].function = {.kind = FunctionKind::kTanh};
  plant.nonlinearities[0].slope_min = 0.0;
  return plant;
}

TEST(ObserverFilter, IsTheObserver) {
  const PlantModel plant = joint_with_everything();
  const ObserverPlant sampled = observer_plant(plant, joint_request(""));
  for (const bool is_decoupling : {true, false}) {
    const ObserverTask task{{1}, {}, 0.001};
    const DesignedObserver observer = some_observer(plant, sampled, task, is_decoupling);
    const ResidualFilter output = output_filter(plant, sampled, observer, "detection");
    const ResidualFilter size = size_filter(plant, sampled, observer, 0, "size_y1");
    ASSERT_LT(spectral_radius(output.F), 1.0);
    FilterRun output_run(output), size_run(size);

    // x̂ = z + T (y - D u);  z' = S (A x̂ + B u + E_o gain φ(E_i x̂)) + Γ (y - D u - C x̂)
    const ObserverModel& model = observer.model;
    MatrixXd A = MatrixXd::Identity(5, 5);
    A.topLeftCorner(4, 4) = sampled.A;
    VectorXd z = VectorXd::Zero(5);
    std::mt19937 random(7);
    std::uniform_real_distribution<double> number(-1.0, 1.0);
    for (int k = 0; k < 200; ++k) {
      const VectorXd y = VectorXd::NullaryExpr(3, [&] { return number(random); });
      const VectorXd u = VectorXd::NullaryExpr(1, [&] { return number(random); });
      const VectorXd x_hat = z + observer.decoupling.T * (y - plant.D * u);
      const VectorXd innovation = y - plant.D * u - model.C * x_hat;
      EXPECT_LT((output_run.step(y, u) - innovation).norm(), 1e-9 * (1.0 + innovation.norm()));
      EXPECT_NEAR(size_run.step(y, u)[0], x_hat[4], 1e-9 * (1.0 + std::abs(x_hat[4])));
      VectorXd driven = A * x_hat;
      driven.head(4) += sampled.B * u;
      driven += model.E_o.col(0) * -0.333 * std::tanh(model.E_i.row(0).dot(x_hat));
      z = observer.decoupling.S * driven + observer.synthesis.gain * innovation;
    }
  }
}

TEST(ObserverFilter, DescribesItsResponseToFaults) {
  // In the loop with the plant, slopes in the middle: e' = F e - L m, r = M e - J m.
  const PlantModel plant = joint_with_everything();
  const ObserverPlant sampled = observer_plant(plant, joint_request(""));
  const DesignedObserver observer = some_observer(plant, sampled, {{}, {}, 0.0}, true);
  ResidualFilter filter = output_filter(plant, sampled, observer, "detection");
  filter.nonlinearities.clear();
  for (Index j = 0; j < 2; ++j) {
    FilterRun run(filter);
    VectorXd x = VectorXd::Zero(4);
    VectorXd e = VectorXd::Zero(4);
    for (int k = 0; k < 50; ++k) {
      const double m = std::sin(0.3 * k) + 0.5;
      const VectorXd y = plant.C * x + m * sampled.fault_outputs.col(j);
      const VectorXd r = run.step(y, VectorXd::Zero(1));
      EXPECT_LT((r - (filter.M * e - filter.J.col(j) * m)).norm(), 1e-10);
      e = (filter.F * e - filter.L.col(j) * m).eval();
      x = (observer.model.A * x + m * sampled.fault_states.col(j)).eval();
    }
  }
}

TEST(ObserverFilter, SeesACarriedFaultOnlyInTransientsAndItsSizeAtRest) {
  const PlantModel plant = flexible_joint_euler();
  const ObserverPlant sampled = observer_plant(plant, joint_request(""));
  const DesignedObserver observer = some_observer(plant, sampled, {{1}, {0}, 0.001}, false);
  const ResidualFilter output = output_filter(plant, sampled, observer, "detection");
  EXPECT_EQ(output.sees[0], Sensitivity::kSteady);
  EXPECT_EQ(output.sees[1], Sensitivity::kTransient);
  const ResidualFilter size = size_filter(plant, sampled, observer, 0, "size_y1");
  EXPECT_EQ(size.sees[1], Sensitivity::kSteady);
  EXPECT_NEAR(rest_gains(size, sampled, observer, -1)(0, 1), 1.0, 1e-9);
  EXPECT_NEAR(rest_gains(size, sampled, observer, 1)(0, 1), 1.0, 1e-9);
  ASSERT_TRUE(size.estimation.has_value());
  EXPECT_EQ(size.estimation->fault, 1u);
}

TEST(ObserverFilter, RestGainsAtACornerAreThoseOfTheLoopThere) {
  const PlantModel plant = flexible_joint_euler();
  const ObserverPlant sampled = observer_plant(plant, joint_request(""));
  const DesignedObserver observer = some_observer(plant, sampled, {{}, {0}, 0.0}, true);
  const ResidualFilter filter = output_filter(plant, sampled, observer, "detection");
  for (Index vertex = 0; vertex < 2; ++vertex) {
    const ErrorDynamics error =
        error_dynamics(observer.model, observer.decoupling, observer.synthesis.gain);
    const MatrixXd A_e = error.N + observer.decoupling.S * observer.model.vertex(vertex);
    for (Index j = 0; j < 2; ++j) {
      const VectorXd driven = observer.decoupling.S * sampled.fault_states.col(j) -
                              observer.synthesis.gain * sampled.fault_outputs.col(j) -
                              observer.decoupling.T * sampled.fault_outputs.col(j);
      VectorXd e = VectorXd::Zero(4);
      for (int k = 0; k < 3000; ++k) e = (A_e * e + driven).eval();
      const VectorXd at_rest = plant.C * e + sampled.fault_outputs.col(j);
      EXPECT_LT((rest_gains(filter, sampled, observer, vertex).col(j) - at_rest).norm(), 1e-9);
    }
  }
}

// No noise and no slope that the bounds allow takes a residual over the threshold, and the worst
// noise takes it there: the threshold of a linear observer is exact.
TEST(ComponentThreshold, IsReachedByTheWorstNoise) {
  PlantModel plant = flexible_joint_euler();
  plant.nonlinearities.clear();
  const ObserverPlant sampled = observer_plant(plant, joint_request(""));
  const DesignedObserver observer = some_observer(plant, sampled, {{}, {0}, 0.0}, true);
  const ObserverModel& model = observer.model;
  const ObserverOutput output = output_error(model);
  const auto threshold =
      component_threshold(model, observer.decoupling, output, observer.synthesis.gain, 0);
  ASSERT_TRUE(threshold.has_value());
  const ErrorDynamics error = error_dynamics(model, observer.decoupling, observer.synthesis.gain);
  constexpr int kSteps = 400;
  for (Index row = 0; row < 3; ++row) {
    // Signs that add up at the last sample: those of the impulse responses, backwards.
    std::vector<Eigen::RowVectorXd> responses{output.Q.row(row) + output.R.row(row) * error.B_next};
    Eigen::RowVectorXd power = output.R.row(row);
    for (int j = 1; j <= kSteps; ++j) {
      const Eigen::RowVectorXd next = power * error.N;
      responses.push_back(power * error.B_now + next * error.B_next);
      power = next;
    }
    VectorXd e = VectorXd::Zero(4);
    VectorXd w = VectorXd::Zero(4);
    double r = 0.0;
    for (int k = 0; k <= kSteps; ++k) {
      const VectorXd before = w;
      w = responses[static_cast<std::size_t>(kSteps - k)].transpose().cwiseSign().cwiseProduct(
          model.w_bound);
      if (k > 0) e = (error.N * e + error.B_now * before + error.B_next * w).eval();
      r = output.R.row(row).dot(e) + output.Q.row(row).dot(w);
      EXPECT_LE(std::abs(r), (*threshold)[row] * (1.0 + 1e-9));
    }
    EXPECT_GT(r, 0.999 * (*threshold)[row]);
  }
}

TEST(ComponentThreshold, RefusesWhatTheSmallGainTheoremDoesNotCover) {
  PlantModel plant = flexible_joint_euler();
  const ObserverPlant sampled = observer_plant(plant, joint_request(""));
  DesignedObserver observer = some_observer(plant, sampled, {{}, {0}, 0.0}, true);
  const ObserverOutput output = output_error(observer.model);
  const auto threshold = [&] {
    return component_threshold(observer.model, observer.decoupling, output, observer.synthesis.gain,
                               0);
  };
  const auto narrow = threshold();
  ASSERT_TRUE(narrow.has_value());
  observer.model.slope_radius[0] *= 0.5;
  EXPECT_LT(threshold()->maxCoeff(), narrow->maxCoeff());
  observer.model.slope_radius[0] = 1e6;
  EXPECT_FALSE(threshold().has_value());
}

}  // namespace
}  // namespace faultline

#include "diagnosis/certify/observer_thresholds.h"

#include <cmath>
#include <cstdint>
#include <numbers>

#include <gtest/gtest.h>

#include "diagnosis/certify/error_bounds.h"
#include "diagnosis/certify/observer_loop.h"
#include "diagnosis/certify/quadratic_bound.h"
#include "tests/diagnosis/certify/observer_cases.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Json = nlohmann::json;

// The oracle's thresholds were computed in double precision by sums of up to 4000 terms.
constexpr double kOracle = 1e-8;

void expect_relatively_near(const MatrixXd& found, const MatrixXd& expected, double tolerance) {
  ASSERT_EQ(found.rows(), expected.rows());
  ASSERT_EQ(found.cols(), expected.cols());
  EXPECT_LE((found - expected).norm(), tolerance * expected.norm()) << "found\n"
                                                                    << found << "\nexpected\n"
                                                                    << expected;
}

VectorXd numbers(const Json& list) {
  const auto values = list.get<std::vector<double>>();
  return VectorXd::Map(values.data(), std::ssize(values));
}

ObserverThresholds thresholds_of(const Bank& bank, std::size_t filter) {
  return observer_thresholds(joint_plant(), bank, bank.filters[filter]);
}

TEST(ObserverThresholds, HaveTheLimitsOfTheOracle) {
  const ObserverCase detection = ObserverCase::detection();
  expect_relatively_near(thresholds_of(detection.bank(), 0).component_limit,
                         detection.matrix("checks/l1_rbar"), kOracle);
  const ObserverCase estimator = ObserverCase::estimator();
  expect_relatively_near(thresholds_of(estimator.bank(), 1).component_limit,
                         estimator.matrix("checks/rigorous_noise_bound_fs"), kOracle);
  // With drifts of the carried fault, which a healthy plant does not have.
  const ObserverCase combined = ObserverCase::combined();
  const Bank bank = combined.bank();
  ObserverLoop loop = observer_loop(joint_plant(), bank, bank.filters[0]);
  ASSERT_EQ(loop.w_bound[4], 0.0);
  loop.w_bound[4] = bank.filters[0].observer->drift_bound[0];
  expect_relatively_near(ErrorBounds(loop).limit(), combined.matrix("checks/l1_rbar"), kOracle);
}

TEST(ObserverThresholds, HaveTheCourseOfTheOracleSampleBySample) {
  for (const ObserverCase& oracle :
       {ObserverCase::detection(), ObserverCase::combined(), ObserverCase::estimator()}) {
    SCOPED_TRACE(oracle.name);
    const ObserverThresholds found = thresholds_of(oracle.bank(), 0);
    const Index last = found.component.rows() - 1;
    for (const auto& [k, sample] : oracle.numbers.at("traces").at(0).at("samples").items()) {
      SCOPED_TRACE(k);
      const VectorXd expected = numbers(sample.at("rbar"));
      expect_relatively_near(found.component.row(std::min<Index>(std::stoi(k), last)).transpose(),
                             expected, kOracle);
    }
  }
}

TEST(ObserverThresholds, HaveTheQuadraticLimitOfTheOracle) {
  const ObserverCase detection = ObserverCase::detection();
  const double limit = detection.matrix("checks/Jth_asymptotic_quadratic")(0, 0);
  EXPECT_NEAR(thresholds_of(detection.bank(), 0).norm_limit, limit, kOracle * limit);

  const ObserverCase combined = ObserverCase::combined();
  const Bank bank = combined.bank();
  const ResidualFilter& filter = bank.filters[0];
  ObserverLoop loop = observer_loop(joint_plant(), bank, filter);
  loop.w_bound[4] = filter.observer->drift_bound[0];
  const QuadraticBound bound = quadratic_bound(loop, *filter.observer, MatrixXd::Identity(3, 3));
  EXPECT_TRUE(bound.is_proved()) << bound.dynamic_eigenvalue << " " << bound.output_eigenvalue;
  const double with_drift = combined.matrix("checks/Jth_asymptotic_quadratic")(0, 0);
  EXPECT_NEAR(bound.limit(), with_drift, kOracle * with_drift);
  EXPECT_LT(thresholds_of(bank, 0).norm_limit, with_drift);
}

TEST(ObserverThresholds, HoldTheirLimitInTheEnd) {
  for (const ObserverCase& oracle :
       {ObserverCase::detection(), ObserverCase::combined(), ObserverCase::estimator()}) {
    SCOPED_TRACE(oracle.name);
    const Bank bank = oracle.bank();
    const ObserverThresholds found = thresholds_of(bank, 0);
    const Index last = found.component.rows() - 1;
    const VectorXd held = found.component.row(last).transpose();
    EXPECT_GE((held - found.component_limit).minCoeff(), 0.0);
    expect_relatively_near(held, found.component_limit, 1e-11);
    // Ten times longer, nothing exceeds it.
    const ObserverLoop loop = observer_loop(joint_plant(), bank, bank.filters[0]);
    const MatrixXd longer =
        ErrorBounds(loop).course(10 * static_cast<std::size_t>(found.component.rows()));
    for (Index k = last; k < longer.rows(); ++k) {
      ASSERT_LE((longer.row(k).transpose() - held).maxCoeff(), 1e-11 * held.maxCoeff()) << k;
    }
  }
}

// Plant (Euler's method) and filter in its implementation form, as the oracle simulated them.
class JointSimulation {
 public:
  JointSimulation(const Bank& bank, std::string scenario)
      : plant_(joint_plant()), bank_(bank), scenario_(std::move(scenario)) {
    x_ = VectorXd{{-0.15, 0.0, 0.2, 0.4}};
    v_ = VectorXd::Zero(bank.filters[0].F.rows());
  }

  // The residuals of all filters at this sample; then on to the next.
  std::vector<VectorXd> step() {
    VectorXd d(3);
    for (double& value : d) value = noise();
    const double n = noise();
    VectorXd y = plant_.C * x_ + n * plant_.noises[0].output;
    if (scenario_ == "sens" && 3000 < k_ && k_ <= 5000) y[0] += 0.2;
    const VectorXd u = VectorXd::Constant(1, 2.0 * std::sin(2.0 * std::numbers::pi * k_ * 0.01));
    std::vector<VectorXd> residuals;
    for (const ResidualFilter& filter : bank_.filters) {
      residuals.emplace_back(filter.M * v_ - filter.H * y + filter.K * u);
    }
    step_filter(bank_.filters[0], y, u);
    VectorXd rate = plant_.A * x_ + plant_.B * u;
    if (scenario_ == "act" && 2000 < k_ && k_ <= 6000) {
      rate += (0.2 + 0.1 * std::sin(0.1 * std::numbers::pi * (k_ - 1000))) * plant_.B;
    }
    for (std::size_t i = 0; i < 3; ++i) {
      rate += d[static_cast<Index>(i)] * plant_.disturbances[i].state;
    }
    rate[3] -= 0.333 * std::sin(x_[2]);
    x_ += 0.01 * rate;
    ++k_;
    return residuals;
  }

 private:
  void step_filter(const ResidualFilter& filter, const VectorXd& y, const VectorXd& u) {
    VectorXd next = filter.F * v_ - filter.E * y + filter.G * u;
    for (const FilterNonlinearity& term : filter.nonlinearities) {
      const double s = term.a_v.dot(v_) + term.a_y.dot(y) + term.a_u.dot(u);
      next += (evaluate(term.function, s) - term.center * s) * term.W;
    }
    v_ = next;
  }

  double noise() {
    seed_ = 1664525u * seed_ + 1013904223u;
    return 0.1 * (2.0 * seed_ / 4294967296.0 - 1.0);
  }

  PlantModel plant_;
  const Bank& bank_;
  std::string scenario_;
  std::uint32_t seed_ = 12345;
  int k_ = 0;
  VectorXd x_, v_;
};

TEST(ObserverThresholds, BelongToFiltersThatReproduceTheResidualsOfTheOracle) {
  for (const ObserverCase& oracle :
       {ObserverCase::detection(), ObserverCase::combined(), ObserverCase::estimator()}) {
    const Bank bank = oracle.bank();
    const ObserverThresholds thresholds = thresholds_of(bank, 0);
    for (const Json& trace : oracle.numbers.at("traces")) {
      SCOPED_TRACE(oracle.name + " " + trace.at("scenario").get<std::string>());
      JointSimulation simulation(bank, trace.at("scenario"));
      const Json& samples = trace.at("samples");
      for (int k = 0; k <= 8000; ++k) {
        const std::vector<VectorXd> r = simulation.step();
        if (trace.at("scenario") == "none") {
          const Index row = std::min<Index>(k, thresholds.component.rows() - 1);
          const VectorXd part =
              r[0].cwiseAbs().cwiseQuotient(thresholds.component.row(row).transpose());
          ASSERT_LE(part.maxCoeff(), 1.0) << "false alarm at " << k;
        }
        const std::string key = std::to_string(k);
        if (!samples.contains(key)) continue;
        EXPECT_LE((r[0] - numbers(samples.at(key).at("r"))).norm(), kOracle) << k;
        if (r.size() > 1) {
          EXPECT_NEAR(r[1][0], samples.at(key).at("fhat").get<double>(), kOracle) << k;
        }
      }
    }
  }
}

}  // namespace
}  // namespace faultline

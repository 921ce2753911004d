// Hou's example in closed loop: plant, bank and evaluation together, against hou_simulation.json.

#include <cmath>

#include <gtest/gtest.h>

#include "diagnosis/model/discretize.h"
#include "diagnosis/model/riccati.h"
#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/evaluator.h"
#include "diagnosis/runtime/residual_bank.h"
#include "tests/diagnosis/geometric_oracle.h"
#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSampleTime_s = 0.01;
constexpr int kSteps = 10000;

/// The plant under u = -K x + 1 with faults on its actuators, everything held over a sample.
class ClosedLoop {
 public:
  explicit ClosedLoop(const PlantModel& plant)
      : C_(plant.C), sampled_(discretize_zoh(plant.A, plant.B, kSampleTime_s)) {
    K_ = lqr_gain(sampled_.A, sampled_.B, MatrixXd::Identity(3, 3), MatrixXd::Identity(4, 4));
    x_ = VectorXd::Zero(3);
    u_ = VectorXd::Ones(4);
  }

  [[nodiscard]] VectorXd y() const { return C_ * x_; }
  [[nodiscard]] const VectorXd& u() const { return u_; }
  void step(const VectorXd& fault) {
    x_ = (sampled_.A * x_ + sampled_.B * (u_ + fault)).eval();
    u_ = VectorXd::Ones(4) - K_ * x_;
  }

 private:
  MatrixXd C_;
  SampledSystem sampled_;
  MatrixXd K_;
  VectorXd x_, u_;
};

VectorXd fault_at(const OracleScenario& scenario, int k) {
  VectorXd fault = VectorXd::Zero(4);
  for (const OracleScenario::Step& step : scenario.steps) {
    if (k >= std::lround(step.at_s / kSampleTime_s)) {
      fault[static_cast<Eigen::Index>(step.fault)] += step.value;
    }
  }
  return fault;
}

struct Outcome {
  std::vector<int> first_crossing;  // per filter, -1: none
  std::vector<double> final_value;
  Decision final_decision;
  std::vector<std::vector<std::size_t>> final_sets;
};

Outcome run(const Bank& bank, const OracleScenario& scenario) {
  ClosedLoop loop(hou_plant());
  ResidualBank filters(bank);
  Evaluator evaluator(bank);
  const DecisionTable table(bank);
  Outcome result;
  result.first_crossing.assign(bank.filters.size(), -1);
  for (int k = 0; k <= kSteps; ++k) {
    const VectorXd y = loop.y();
    filters.step({y.data(), 3}, {loop.u().data(), 4});
    evaluator.step(filters.evaluation(), filters.thresholds());
    for (std::size_t i = 0; i < bank.filters.size(); ++i) {
      if (evaluator.fired()[i] != 0 && result.first_crossing[i] < 0) {
        result.first_crossing[i] = k;
      }
    }
    loop.step(fault_at(scenario, k));
  }
  result.final_value.assign(filters.residual().begin(), filters.residual().end());
  result.final_decision = table.decide(evaluator.signature());
  for (std::uint32_t s = 0; s < result.final_decision.set_count; ++s) {
    result.final_sets.push_back(table.sets()[result.final_decision.sets[s]]);
  }
  return result;
}

OracleScenario steps_at_50_s(std::vector<std::pair<std::size_t, double>> faults) {
  OracleScenario scenario;
  for (const auto& [fault, value] : faults) {
    scenario.steps.push_back({fault, 50.0, value});
  }
  return scenario;
}

using Sets = std::vector<std::vector<std::size_t>>;

TEST(HouSimulation, CrossesThresholdsWithinOneSampleOfTheOracle) {
  const Bank bank = hou_bank(false, 1);
  const std::vector<OracleScenario> scenarios = oracle_scenarios();
  ASSERT_GE(scenarios.size(), 15u);
  for (const OracleScenario& scenario : scenarios) {
    const Outcome found = run(bank, scenario);
    for (std::size_t i = 0; i < bank.filters.size(); ++i) {
      SCOPED_TRACE(scenario.name + " " + bank.filters[i].name);
      const OracleScenario::Residual& expected = scenario.residuals.at(bank.filters[i].name);
      EXPECT_NEAR(std::abs(found.final_value[i]), std::abs(expected.final_value), 1e-8);
      ASSERT_EQ(found.first_crossing[i] >= 0, expected.first_crossing_s.has_value());
      if (expected.first_crossing_s) {
        EXPECT_NEAR(found.first_crossing[i] * kSampleTime_s, *expected.first_crossing_s,
                    1.001 * kSampleTime_s);
      }
    }
  }
}

TEST(HouSimulation, StaysAtRoundingErrorWithoutFaults) {
  // Gains are 10 to 17 after normalisation, y and u of size one: 1e-12 is rounding error, while
  // holding y instead of interpolating it would leave about 1e-4.
  const Outcome found = run(hou_bank(), OracleScenario());
  for (const double r : found.final_value) {
    EXPECT_LT(std::abs(r), 1e-12);
  }
  EXPECT_EQ(found.final_decision.verdict, Verdict::kHealthy);
}

TEST(HouSimulation, IsolatesEverySingleFaultAndEveryPair) {
  const Bank bank = hou_bank();
  for (std::size_t i = 0; i < 4; ++i) {
    const Outcome single = run(bank, steps_at_50_s({{i, 2.0}}));
    EXPECT_EQ(single.final_decision.verdict, Verdict::kIsolated);
    EXPECT_EQ(single.final_sets, (Sets{{i}}));
    for (std::size_t j = i + 1; j < 4; ++j) {
      const Outcome pair = run(bank, steps_at_50_s({{i, 2.0}, {j, 1.5}}));
      EXPECT_EQ(pair.final_decision.verdict, Verdict::kIsolated) << i << j;
      EXPECT_EQ(pair.final_sets, (Sets{{i, j}}));
    }
  }
}

TEST(HouSimulation, NamesAllPairsThatExplainACancellation) {
  // F2 = 2, F3 = -2 cancel in r14, and so would F1 = -2 F4 in r23: the same residuals fire.
  const Outcome found = run(hou_bank(), steps_at_50_s({{1, 2.0}, {2, -2.0}}));
  EXPECT_EQ(found.final_decision.verdict, Verdict::kAmbiguous);
  EXPECT_EQ(found.final_sets, (Sets{{0, 3}, {1, 2}}));
}

TEST(HouSimulation, DoesNotTellIndistinguishableFaultsApart) {
  // null(B) = (2, 1, -1, -1): the outputs are the same.
  for (const auto& faults :
       {steps_at_50_s({{0, 4.0}, {1, 2.0}}), steps_at_50_s({{2, 2.0}, {3, 2.0}})}) {
    const Outcome found = run(hou_bank(), faults);
    EXPECT_EQ(found.final_decision.verdict, Verdict::kAmbiguous);
    EXPECT_EQ(found.final_sets, (Sets{{0, 1}, {2, 3}}));
  }
}

TEST(HouSimulation, LeavesThreeFaultsUnexplained) {
  const Outcome found = run(hou_bank(), steps_at_50_s({{0, 2.0}, {1, 3.0}, {2, 1.0}}));
  EXPECT_EQ(found.final_decision.verdict, Verdict::kUnexplained);
}

TEST(HouSimulation, LeavesAPartialSignatureUnexplained) {
  // With one raw threshold of 0.05 a fault F1 = 1 fires r23 alone.
  const Outcome found = run(hou_bank(false), steps_at_50_s({{0, 1.0}}));
  EXPECT_EQ(found.final_decision.verdict, Verdict::kUnexplained);
}

}  // namespace
}  // namespace faultline

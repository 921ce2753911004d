// Observers at run time: their equations, their thresholds, and what two of them isolate.

#include "tests/diagnosis/observer_bank.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/evaluator.h"
#include "diagnosis/runtime/onset.h"
#include "diagnosis/runtime/residual_bank.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

class RandomObservers {
 public:
  explicit RandomObservers(std::uint64_t seed) : engine_(seed) {}

  MatrixXd matrix(Index rows, Index cols) {
    return MatrixXd::NullaryExpr(rows, cols, [this] { return normal_(engine_); });
  }
  MatrixXd positive(Index rows, Index cols) {
    return MatrixXd(matrix(rows, cols).cwiseAbs().array() + 0.1);
  }
  Index whole(Index smallest, Index largest) {
    return std::uniform_int_distribution<Index>(smallest, largest)(engine_);
  }

  /// Order 1..6, 1..3 rows, 0..2 terms; every third filter is linear, without a course.
  ResidualFilter filter(std::size_t number, Index q, Index m) {
    const Index d = whole(1, 6), rows = whole(1, 3);
    ResidualFilter filter;
    filter.F = 0.1 * matrix(d, d);
    filter.E = matrix(d, q);
    filter.G = matrix(d, m);
    filter.M = matrix(rows, d);
    filter.H = matrix(rows, q);
    filter.K = matrix(rows, m);
    filter.threshold = 0.7;
    if (number % 3 == 2) return filter;
    for (Index i = whole(0, 2); i > 0; --i) {
      FilterNonlinearity term;
      term.function.kind = i == 1 ? FunctionKind::kSin : FunctionKind::kTanh;
      term.center = 0.25;
      term.W = 0.3 * matrix(d, 1);
      term.a_v = matrix(d, 1);
      term.a_y = matrix(q, 1);
      term.a_u = matrix(m, 1);
      filter.nonlinearities.push_back(term);
    }
    filter.evaluation = number % 3 == 0 ? Evaluation::kNorm : Evaluation::kComponent;
    const Index samples = whole(1, 12);
    filter.course =
        ThresholdCourse{matrix(rows, rows), positive(samples, 1), positive(samples, rows)};
    filter.threshold =
        filter.evaluation == Evaluation::kNorm ? filter.course->norm[samples - 1] : 1.0;
    return filter;
  }

  Bank bank(std::size_t count, Index q, Index m) {
    Bank bank;
    bank.output_names.resize(static_cast<std::size_t>(q));
    bank.input_names.resize(static_cast<std::size_t>(m));
    bank.y_operating = matrix(q, 1);
    bank.u_operating = matrix(m, 1);
    for (std::size_t i = 0; i < count; ++i) bank.filters.push_back(filter(i, q, m));
    return bank;
  }

 private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

/// The bank's equations as they are written.
struct Reference {
  explicit Reference(const Bank& bank) : bank_(bank) {
    for (const ResidualFilter& filter : bank.filters) v.push_back(VectorXd::Zero(filter.F.rows()));
  }

  void step(const VectorXd& y, const VectorXd& u) {
    const VectorXd dy = y - bank_.y_operating, du = u - bank_.u_operating;
    r.clear();
    for (std::size_t i = 0; i < v.size(); ++i) {
      const ResidualFilter& f = bank_.filters[i];
      r.push_back(f.M * v[i] - f.H * dy + f.K * du);
      VectorXd next = f.F * v[i] - f.E * dy + f.G * du;
      for (const FilterNonlinearity& term : f.nonlinearities) {
        const double s = term.a_v.dot(v[i]) + term.a_y.dot(dy) + term.a_u.dot(du);
        const double phi = term.function.kind == FunctionKind::kSin ? std::sin(s) : std::tanh(s);
        next += term.W * (phi - term.center * s);
      }
      v[i] = next;
    }
  }

  const Bank& bank_;
  std::vector<VectorXd> v, r;
};

/// Index of the row of a course that holds at sample k.
Index held(const ThresholdCourse& course, int k) {
  return std::min<Index>(k, course.norm.size() - 1);
}

void expect_evaluation(const ResidualFilter& filter, const VectorXd& r, int k, double evaluation,
                       double threshold) {
  const double slack = 1e-11 * (1.0 + r.norm());
  if (!filter.course) {
    EXPECT_NEAR(evaluation, r.norm(), slack);
    EXPECT_EQ(threshold, filter.threshold);
  } else if (filter.evaluation == Evaluation::kNorm) {
    EXPECT_NEAR(evaluation, (filter.course->weight * r).norm(), 10.0 * slack);
    EXPECT_EQ(threshold, filter.course->norm[held(*filter.course, k)]);
  } else {
    const VectorXd bound = filter.course->component.row(held(*filter.course, k));
    EXPECT_NEAR(evaluation, (r.cwiseAbs().array() / bound.array()).maxCoeff(), 10.0 * slack);
    EXPECT_EQ(threshold, 1.0);
  }
}

TEST(ObserverBank, FulfilsItsEquationsForFiltersOfAllShapes) {
  const std::uint64_t seed = test_seed(60);
  SCOPED_TRACE(seed_message(seed));
  RandomObservers random(seed);
  for (const std::size_t count : {1u, 8u, 9u, 30u}) {
    const Bank bank = random.bank(count, 3, 2);
    ResidualBank filters(bank);
    Reference reference(bank);
    for (int k = 0; k < 20; ++k) {
      SCOPED_TRACE(k);
      const VectorXd y = random.matrix(3, 1), u = random.matrix(2, 1);
      filters.step({y.data(), 3}, {u.data(), 2});
      reference.step(y, u);
      std::size_t row = 0;
      for (std::size_t i = 0; i < count; ++i) {
        const ResidualFilter& filter = bank.filters[i];
        const VectorXd& r = reference.r[i];
        expect_evaluation(filter, r, k, filters.evaluation()[i], filters.thresholds()[i]);
        for (Index j = 0; j < r.size(); ++j, ++row) {
          EXPECT_NEAR(filters.residual()[row], r[j], 1e-11 * (1.0 + r.norm()));
          EXPECT_EQ(filters.row_thresholds()[row],
                    filter.course ? filter.course->component(held(*filter.course, k), j)
                                  : ResidualBank::kNoThreshold);
        }
      }
    }
  }
}

TEST(ObserverBank, LeavesTheBitsOfLinearFiltersAlone) {
  RandomObservers random(61);
  Bank mixed = random.bank(20, 3, 2);
  // The same order and place in the lanes: only terms and courses go.
  Bank linear = mixed;
  for (ResidualFilter& filter : linear.filters) {
    filter.nonlinearities.clear();
    filter.course.reset();
    filter.evaluation = Evaluation::kNorm;
  }
  ResidualBank with(mixed), without(linear);
  for (int k = 0; k < 50; ++k) {
    const VectorXd y = random.matrix(3, 1), u = random.matrix(2, 1);
    with.step({y.data(), 3}, {u.data(), 2});
    without.step({y.data(), 3}, {u.data(), 2});
    std::size_t row = 0;
    for (std::size_t i = 0; i < mixed.filters.size(); ++i) {
      for (Index j = 0; j < mixed.filters[i].H.rows(); ++j, ++row) {
        if (mixed.filters[i].nonlinearities.empty()) {
          ASSERT_EQ(with.residual()[row], without.residual()[row]) << "filter " << i;
        }
      }
      if (!mixed.filters[i].course) {
        ASSERT_EQ(with.evaluation()[i], without.evaluation()[i]) << "filter " << i;
      }
    }
  }
}

TEST(ObserverBank, FollowsThePlantItWasMadeFor) {
  ResidualBank filters(observer_bank());
  ObservedPlant plant;
  for (int k = 0; k < 200; ++k) {
    const std::vector<double> u = {std::sin(0.2 * k)};
    filters.step(plant.y(), u);
    plant.step(u[0]);
    for (const double r : filters.residual()) EXPECT_NEAR(r, 0.0, 1e-13) << k;
  }
  plant.f_y1 = 0.3;
  for (int k = 0; k < 200; ++k) {
    const std::vector<double> u = {std::sin(0.2 * k)};
    filters.step(plant.y(), u);
    plant.step(u[0]);
  }
  EXPECT_NEAR(filters.residual()[0], 0.0, 1e-9);
  EXPECT_NEAR(filters.residual()[1], 0.0, 1e-9);
  EXPECT_NEAR(filters.residual()[2], 0.3, 1e-9);
}

TEST(ObserverBank, BeginsItsCourseAgainOnReset) {
  ResidualBank filters(observer_bank());
  EXPECT_EQ(filters.thresholds()[1], 0.2) << "before the first sample";
  const std::vector<double> y = {0.5, -1.0}, u = {0.25};
  std::vector<std::vector<double>> first;
  for (int round = 0; round < 2; ++round) {
    for (std::size_t k = 0; k < 6; ++k) {
      filters.step(y, u);
      std::vector<double> found(filters.thresholds().begin(), filters.thresholds().end());
      found.insert(found.end(), filters.row_thresholds().begin(), filters.row_thresholds().end());
      found.insert(found.end(), filters.residual().begin(), filters.residual().end());
      found.insert(found.end(), filters.evaluation().begin(), filters.evaluation().end());
      if (round == 0) {
        first.push_back(found);
      } else {
        EXPECT_EQ(found, first[k]) << k;
      }
    }
    EXPECT_EQ(filters.thresholds()[1], 0.02) << "the last holds";
    filters.reset();
    EXPECT_EQ(filters.thresholds()[1], 0.2);
    EXPECT_EQ(filters.row_thresholds()[0], 0.2);
  }
}

TEST(ObserverBank, EvaluatesANanAsANan) {
  for (const bool is_first : {true, false}) {
    ResidualBank filters(observer_bank());
    const std::vector<double> y = {is_first ? kNaN : 100.0, is_first ? 100.0 : kNaN}, u = {0.0};
    filters.step(y, u);
    filters.step(y, u);
    EXPECT_TRUE(std::isnan(filters.evaluation()[0]));
    EXPECT_TRUE(std::isnan(filters.evaluation()[1]));
  }
}

TEST(ObserverBank, DoesNotTouchTheHeapInAThousandSteps) {
  RandomObservers random(62);
  const Bank bank = random.bank(20, 3, 2);
  ResidualBank filters(bank);
  Evaluator evaluator(bank);
  const VectorXd y = random.matrix(3, 1), u = random.matrix(2, 1);
  const AllocationGuard guard;
  for (int k = 0; k < 1000; ++k) {
    filters.step({y.data(), 3}, {u.data(), 2});
    evaluator.step(filters.evaluation(), filters.thresholds());
    if (k % 100 == 0) {
      filters.reset();
      evaluator.contaminate_start();
    }
  }
  const std::uint64_t heap_calls = guard.heap_calls();
  EXPECT_EQ(heap_calls, 0u);
}

/// Observers, evaluation, decision, settling and onset, on the plant they were made for.
class ObserverChain {
 public:
  ObserverChain()
      : bank_(observer_bank()),
        filters_(bank_),
        evaluator_(bank_),
        table_(bank_),
        settling_(bank_.decision, 1),
        onset_(1) {}

  /// Runs until cycle `last` was sampled.
  void run_to(std::uint32_t last) {
    for (; cycle_ <= last; ++cycle_) {
      const std::vector<double> u = {0.3 * std::sin(0.2 * cycle_)};
      filters_.step(plant.y(), u);
      plant.step(u[0]);
      evaluator_.step(filters_.evaluation(), filters_.thresholds());
      const Decision decision = table_.decide(evaluator_.signature(), evaluator_.persistent());
      settling_.step(decision, evaluator_.signature());
      last_onset = onset_.step(settling_, evaluator_, cycle_);
      note();
    }
  }

  ObservedPlant plant;
  std::vector<std::pair<std::string, std::uint32_t>> announced;  ///< what, from which cycle on
  Onset last_onset;

 private:
  void note() {
    const Decision& decision = settling_.announced();
    std::string text(verdict_name(decision.verdict));
    for (std::uint32_t s = 0; s < decision.set_count; ++s) {
      for (const std::size_t fault : table_.sets()[decision.sets[s]]) {
        text += " " + bank_.fault_names[fault];
      }
    }
    if (announced.empty() || announced.back().first != text) announced.emplace_back(text, cycle_);
  }

  Bank bank_;
  ResidualBank filters_;
  Evaluator evaluator_;
  DecisionTable table_;
  Settling settling_;
  OnsetTracker onset_;
  std::uint32_t cycle_ = 0;
};

using Announced = std::vector<std::pair<std::string, std::uint32_t>>;

TEST(ObserverChain, CallsAnAlarmThatStaysTheActuator) {
  ObserverChain chain;
  chain.run_to(49);
  chain.plant.f_u = 0.2;
  chain.run_to(300);
  // y is one sample behind u. Detection is above from 51 on, the estimate from 52 on, and each
  // fires one sample later: ambiguous from 53 on, announced with the third sample. Detection fires
  // since 52, for more than 10 samples with that of 62.
  EXPECT_EQ(
      chain.announced,
      (Announced{{"inhibited", 0}, {"healthy", 2}, {"ambiguous u y1", 55}, {"isolated u", 64}}));
  EXPECT_EQ(chain.last_onset.cycle, 51);
}

TEST(ObserverChain, CallsAnAlarmAtTheEdgeOfAnEstimateThatStaysTheSensor) {
  ObserverChain chain;
  chain.run_to(49);
  chain.plant.f_y1 = 0.2;
  chain.run_to(300);
  // Detection is above from 50 to 57, the estimate from 51 on.
  EXPECT_EQ(
      chain.announced,
      (Announced{{"inhibited", 0}, {"healthy", 2}, {"ambiguous u y1", 54}, {"isolated y1", 61}}));
  EXPECT_EQ(chain.last_onset.cycle, 50) << "not where detection cleared";
  EXPECT_EQ(chain.last_onset.last_cycle, 58);
}

TEST(ObserverChain, KeepsTheSensorThroughAChangeOfItsFault) {
  ObserverChain chain;
  chain.run_to(49);
  chain.plant.f_y1 = 0.2;
  chain.run_to(149);
  chain.plant.f_y1 = -0.3;
  chain.run_to(300);
  ASSERT_GE(chain.announced.size(), 4u);
  EXPECT_EQ(chain.announced.back().first, "isolated y1");
  for (const auto& [text, cycle] : chain.announced) EXPECT_NE(text, "isolated u") << cycle;
}

TEST(ObserverChain, HasNoAlarmFromTheFirstSampleOn) {
  ObserverChain chain;
  chain.run_to(500);
  EXPECT_EQ(chain.announced, (Announced{{"inhibited", 0}, {"healthy", 2}}));
}

}  // namespace
}  // namespace faultline

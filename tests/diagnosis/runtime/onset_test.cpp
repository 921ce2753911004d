#include "diagnosis/runtime/onset.h"

#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

constexpr std::uint32_t kDwell = 3;
constexpr std::uint32_t kSettle = 3;

/// Hou's residuals r12, r13, r14, r23, r24, r34 with threshold 1; all use the one channel.
Bank hou_structure() {
  Bank bank;
  bank.concurrent = 2;
  bank.decision.dwell = kDwell;
  bank.decision.settle = kSettle;
  bank.output_names = {"y1"};
  bank.fault_names = {"u1", "u2", "u3", "u4"};
  for (const std::string row : {"..xx", ".x.x", ".xx.", "x..x", "x.x.", "xx.."}) {
    ResidualFilter filter;
    for (const char cell : row) {
      filter.sees.push_back(cell == '.' ? Sensitivity::kNone : Sensitivity::kSteady);
    }
    filter.E = filter.H = Eigen::MatrixXd::Ones(1, 1);
    filter.G = filter.K = Eigen::MatrixXd(1, 0);
    filter.threshold = 1.0;
    filter.forget_samples = 20;
    bank.filters.push_back(filter);
  }
  return bank;
}

/// Evaluation, decision, settling and onset, one sample after the other.
class Sequence {
 public:
  explicit Sequence(std::uint32_t first_cycle = 0, Bank bank = hou_structure())
      : bank_(std::move(bank)),
        evaluator_(bank_),
        table_(bank_),
        settling_({.settle = kSettle}, 1),
        tracker_(1),
        next_(first_cycle) {}

  /// Samples up to and including `last`, with the residuals marked '1' above their threshold.
  void run_to(std::uint32_t last, const std::string& above) {
    do {
      std::vector<double> evaluation;
      for (const char mark : above) {
        evaluation.push_back(mark == '1' ? 2.0 : 0.5);
      }
      evaluator_.step(evaluation, std::vector<double>(evaluation.size(), 1.0));
      const Decision decision =
          evaluator_.is_any_contaminated()
              ? Decision{.verdict = Verdict::kInhibited}
              : table_.decide(evaluator_.signature(), evaluator_.persistent());
      settling_.step(decision, evaluator_.signature());
      onset_ = tracker_.step(settling_, evaluator_, next_);
    } while (next_++ != last);
  }
  void contaminate() { evaluator_.contaminate_all(); }
  void reset() {
    evaluator_.reset();
    settling_.reset();
    tracker_.reset();
  }

  [[nodiscard]] const Onset& onset() const { return onset_; }
  /// "isolated 2 3", faults counted from 1.
  [[nodiscard]] std::string verdict() const {
    std::string text(verdict_name(settling_.announced().verdict));
    if (settling_.announced().verdict == Verdict::kIsolated) {
      for (const std::size_t fault : table_.sets()[settling_.announced().sets[0]]) {
        text += " " + std::to_string(fault + 1);
      }
    }
    return text;
  }

 private:
  Bank bank_;
  Evaluator evaluator_;
  DecisionTable table_;
  Settling settling_;
  OnsetTracker tracker_;
  Onset onset_;
  std::uint32_t next_;
};

TEST(OnsetTracker, HasNoneWhileNothingHasCrossed) {
  Sequence run;
  run.run_to(100, "000000");
  EXPECT_EQ(run.verdict(), "healthy");
  EXPECT_EQ(run.onset(), Onset());
}

TEST(OnsetTracker, TellsWhereTheFirstCrossingBeganAndTheLast) {
  Sequence run;
  run.run_to(49, "000000");
  run.run_to(50, "000010");
  run.run_to(51, "000011");
  run.run_to(100, "000111");
  EXPECT_EQ(run.verdict(), "isolated 1");
  EXPECT_EQ(run.onset().cycle, 50);
  EXPECT_EQ(run.onset().filter, 4);
  EXPECT_EQ(run.onset().last_cycle, 52);
}

TEST(OnsetTracker, GivesASecondFaultItsOwnOnset) {
  Sequence run;
  run.run_to(4999, "000000");
  run.run_to(6999, "000111");
  EXPECT_EQ(run.verdict(), "isolated 1");
  EXPECT_EQ(run.onset().cycle, 5000);
  run.run_to(10000, "101111");
  EXPECT_EQ(run.verdict(), "isolated 1 3");
  EXPECT_EQ(run.onset().cycle, 7000);
  EXPECT_EQ(run.onset().last_cycle, 7000);
}

TEST(OnsetTracker, KeepsTheFirstCrossingThroughAnUnexplainedSignature) {
  Sequence run;
  run.run_to(49, "000000");
  run.run_to(59, "000100");
  EXPECT_EQ(run.verdict(), "unexplained");
  EXPECT_EQ(run.onset().cycle, 50);
  run.run_to(100, "000111");
  EXPECT_EQ(run.verdict(), "isolated 1");
  EXPECT_EQ(run.onset().cycle, 50);
  EXPECT_EQ(run.onset().last_cycle, 60);
}

TEST(OnsetTracker, GivesADecisionThatReturnsItsOldOnset) {
  Sequence run;
  run.run_to(49, "000000");
  run.run_to(99, "000111");
  run.run_to(120, "111111");
  EXPECT_EQ(run.verdict(), "unexplained");
  EXPECT_EQ(run.onset().cycle, 100);
  run.run_to(200, "000111");
  EXPECT_EQ(run.verdict(), "isolated 1");
  EXPECT_EQ(run.onset().cycle, 50);
  EXPECT_EQ(run.onset().last_cycle, 121) << "only from there on the faults are what they are";
}

TEST(OnsetTracker, TellsWhenAFaultWentThatHadBeenThere) {
  Sequence run;
  run.run_to(49, "000000");
  run.run_to(99, "000111");
  run.run_to(150, "000000");
  EXPECT_EQ(run.verdict(), "healthy");
  EXPECT_EQ(run.onset().cycle, 100);
}

TEST(OnsetTracker, GivesADecisionThatKnowsMoreOfAnAmbiguousOneItsOnset) {
  // u1, u4 cancel in r23, or u2, u3 in r14, which fires in the end.
  Sequence run;
  run.run_to(49, "000000");
  run.run_to(99, "110011");
  EXPECT_EQ(run.verdict(), "ambiguous");
  EXPECT_EQ(run.onset().cycle, 50);
  run.run_to(150, "111011");
  EXPECT_EQ(run.verdict(), "isolated 2 3");
  EXPECT_EQ(run.onset().cycle, 50);
  EXPECT_EQ(run.onset().last_cycle, 100);
}

TEST(OnsetTracker, KeepsItsOnsetWhereNothingCrossedButAResidualBecamePersistent) {
  Bank bank = hou_structure();
  bank.concurrent = 1;
  bank.fault_names = {"y1"};
  bank.filters.resize(1);
  bank.filters[0].sees = {Sensitivity::kTransient};
  bank.filters[0].transient_samples = 5;
  Sequence run(0, bank);
  run.run_to(49, "0");
  run.run_to(55, "1");
  EXPECT_EQ(run.verdict(), "isolated 1");
  EXPECT_EQ(run.onset().cycle, 50);
  run.run_to(80, "1");
  EXPECT_EQ(run.verdict(), "unexplained") << "y1 does not make it fire for so long";
  EXPECT_EQ(run.onset().cycle, 50);
  EXPECT_EQ(run.onset().last_cycle, 50);
}

TEST(OnsetTracker, GivesAFaultThatLeftAnAmbiguousPairItsOwnOnset) {
  Sequence run;
  run.run_to(49, "000000");
  run.run_to(99, "110011");
  run.run_to(150, "000111");
  EXPECT_EQ(run.verdict(), "isolated 1");
  EXPECT_EQ(run.onset().cycle, 100) << "another set than those of before";
}

TEST(OnsetTracker, HasNoneWhileInhibitedAndItsOldOneAfterwards) {
  Sequence run;
  run.run_to(49, "000000");
  run.run_to(99, "000111");
  run.contaminate();
  run.run_to(110, "000111");
  EXPECT_EQ(run.verdict(), "inhibited");
  EXPECT_EQ(run.onset(), Onset());
  run.run_to(200, "000111");
  EXPECT_EQ(run.verdict(), "isolated 1");
  EXPECT_EQ(run.onset().cycle, 50);
}

TEST(OnsetTracker, ForgetsEverythingOnReset) {
  Sequence run;
  run.run_to(99, "000111");
  EXPECT_EQ(run.onset().cycle, 0);
  run.reset();
  run.run_to(199, "000000");
  EXPECT_EQ(run.onset(), Onset());
  run.run_to(299, "000111");
  EXPECT_EQ(run.onset().cycle, 200);
}

TEST(OnsetTracker, CountsThroughTheWrapOfTheCycle) {
  Sequence run(4294967290u);
  run.run_to(4294967294u, "000000");
  run.run_to(10, "000111");
  EXPECT_EQ(run.verdict(), "isolated 1");
  EXPECT_EQ(run.onset().cycle, 4294967295);
}

TEST(OnsetTracker, DoesNotTouchTheHeapInAThousandSteps) {
  const Bank bank = hou_structure();
  Evaluator evaluator(bank);
  const DecisionTable table(bank);
  Settling settling({.settle = kSettle}, 1);
  OnsetTracker tracker(1);
  std::vector<double> evaluation(6);
  const std::vector<double> thresholds(6, 1.0);
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) {
    for (std::size_t i = 0; i < evaluation.size(); ++i) {
      evaluation[i] = (k / 20 + i) % 3 == 0 ? 2.0 : 0.0;
    }
    evaluator.step(evaluation, thresholds);
    settling.step(table.decide(evaluator.signature()), evaluator.signature());
    tracker.step(settling, evaluator, k);
    if (k % 300 == 0) {
      tracker.reset();
    }
  }
  const std::uint64_t heap_calls = guard.heap_calls();
  EXPECT_EQ(heap_calls, 0u);
}

}  // namespace
}  // namespace faultline

#include "tools/bench/run_history.h"

#include <algorithm>
#include <map>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tools/bench/bench_inputs.h"
#include "tools/bench/verdict_report.h"

namespace faultline {
namespace {

using testing::ElementsAre;

/// Two faults, one filter, ten samples a second; sets: {}, {a}, {b}, {a, b}.
class RunHistoryTest : public testing::Test {
 protected:
  RunHistoryTest() {
    bank_.sample_time_s = 0.1;
    bank_.fault_names = {"a", "b"};
    bank_.filters.resize(1);
    bank_.filters[0].M = Eigen::MatrixXd::Ones(1, 1);
    plant_.A = Eigen::MatrixXd::Zero(1, 1);
    plant_.B = Eigen::MatrixXd::Zero(1, 2);
    plant_.C = Eigen::MatrixXd::Zero(1, 1);
    plant_.input_names = {"a", "b"};
    plant_.output_names = {"y"};
  }

  DiagnosisRecord record(std::uint32_t cycle, Verdict verdict, std::uint32_t set = 0) const {
    DiagnosisRecord record(bank_);
    record.cycle = cycle;
    record.decision.verdict = verdict;
    if (verdict == Verdict::kIsolated) {
      record.decision.set_count = 1;
      record.decision.sets[0] = set;
    }
    record.fired[0] = verdict == Verdict::kIsolated ? 1 : 0;
    return record;
  }

  Bank bank_;
  PlantModel plant_;
  std::vector<std::vector<std::size_t>> sets_{{}, {0}, {1}, {0, 1}};
};

TEST_F(RunHistoryTest, TellsDelaysFromInjectionToVerdict) {
  const FaultSchedule schedule(plant_, {{.target = "b", .value = 1.0, .at_s = 1.0}});
  RunHistory history(bank_, sets_, {}, schedule);
  for (std::uint32_t k = 0; k < 12; ++k) history.on_record(record(k, Verdict::kHealthy));
  history.on_record(record(12, Verdict::kUnexplained));
  history.on_record(record(13, Verdict::kIsolated, 1));  // the wrong set
  history.on_record(record(14, Verdict::kIsolated, 2));
  ASSERT_EQ(history.injections().size(), 2U);
  EXPECT_TRUE(history.injections()[0].faults.empty());
  EXPECT_FALSE(history.injections()[0].detection_delay_s);
  const InjectionOutcome& outcome = history.injections()[1];
  EXPECT_THAT(outcome.faults, ElementsAre("b"));
  EXPECT_NEAR(outcome.detection_delay_s.value(), 0.2, 1e-9);
  EXPECT_NEAR(outcome.isolation_delay_s.value(), 0.4, 1e-9);
  EXPECT_EQ(verdict_text(history.verdicts()[outcome.last_verdict]), "isolated b");
  EXPECT_NEAR(history.first_fired_s()[0].value(), 1.3, 1e-9);
}

TEST_F(RunHistoryTest, MeetsAnExpectationOnlyIfEverySampleAgrees) {
  const FaultSchedule schedule(plant_, {});
  Scenario scenario;
  scenario.expectations = {
      {.from_s = 0.0, .until_s = 0.5, .verdicts = {Verdict::kHealthy}},
      {.from_s = 0.0, .until_s = 0.6, .verdicts = {Verdict::kHealthy}},
      {.from_s = 0.6, .until_s = 0.6, .verdicts = {Verdict::kIsolated}, .faults = {"a"}},
      {.from_s = 0.6, .until_s = 0.6, .verdicts = {Verdict::kIsolated}, .faults = {"b"}},
      {.from_s = 9.0, .until_s = 9.5, .verdicts = {Verdict::kHealthy}}};
  RunHistory history(bank_, sets_, scenario, schedule);
  for (std::uint32_t k = 0; k < 6; ++k) history.on_record(record(k, Verdict::kHealthy));
  history.on_record(record(6, Verdict::kIsolated, 1));
  const auto outcomes = history.expectations();
  EXPECT_TRUE(outcomes[0].is_met);
  EXPECT_EQ(outcomes[0].samples, 6U);
  EXPECT_FALSE(outcomes[1].is_met);
  EXPECT_NEAR(outcomes[1].first_unmet->t_s, 0.6, 1e-9);
  EXPECT_TRUE(outcomes[2].is_met);
  EXPECT_FALSE(outcomes[3].is_met);
  EXPECT_FALSE(outcomes[4].is_met) << "no sample came to it";
  EXPECT_FALSE(history.are_expectations_met());
}

/// What became of `expectation` in a run with these verdicts, ten a second.
class ExpectationWatchTest : public RunHistoryTest {
 protected:
  struct Answer {
    Verdict verdict;
    std::vector<std::uint32_t> sets{};
    MessageFault fault = MessageFault::kNone;
    const char* blamed = "";
  };

  DiagnosisRecord record_of(std::uint32_t cycle, const Answer& answer) const {
    DiagnosisRecord found = record(cycle, answer.verdict);
    found.decision.set_count = static_cast<std::uint32_t>(answer.sets.size());
    std::copy(answer.sets.begin(), answer.sets.end(), found.decision.sets.begin());
    found.fault = answer.fault;
    found.blamed_message = answer.blamed;
    return found;
  }

  RunHistory history_of(const Expectation& expectation) const {
    Scenario scenario;
    scenario.expectations = {expectation};
    return {bank_, sets_, scenario, schedule_};
  }

  ExpectationOutcome outcome(const Expectation& expectation, const std::vector<Answer>& answers) {
    RunHistory history = history_of(expectation);
    for (std::uint32_t k = 0; k < answers.size(); ++k) history.on_record(record_of(k, answers[k]));
    return history.expectations().front();
  }

  const FaultSchedule schedule_{plant_, {}};
  const Answer healthy_{Verdict::kHealthy};
  const Answer inhibited_{Verdict::kInhibited};
  const Answer a_{Verdict::kIsolated, {1}};
  const Answer b_{Verdict::kIsolated, {2}};
};

TEST_F(ExpectationWatchTest, AllowsAnyVerdictOfAList) {
  const Expectation expectation{
      .until_s = 0.2, .verdicts = {Verdict::kHealthy, Verdict::kIsolated}, .faults = {"a"}};
  EXPECT_TRUE(outcome(expectation, {healthy_, a_, healthy_}).is_met);
  const ExpectationOutcome other = outcome(expectation, {healthy_, a_, b_});
  EXPECT_EQ(other.found, "found isolated b at 0.2 s");
  EXPECT_EQ(expectation_text(other),
            "NOT MET 0 .. 0.2 s  healthy or isolated a; found isolated b "
            "at 0.2 s");
}

TEST_F(ExpectationWatchTest, WantsTheVerdictByTheDeadlineAndFromThenOn) {
  const Expectation expectation{.from_s = 0.1,
                                .until_s = 0.5,
                                .verdicts = {Verdict::kIsolated},
                                .faults = {"a"},
                                .within_s = 0.25};
  const ExpectationOutcome met = outcome(expectation, {b_, b_, a_, a_, a_, a_});
  EXPECT_TRUE(met.is_met);
  EXPECT_NEAR(met.delay_s.value(), 0.1, 1e-9);
  EXPECT_EQ(expectation_text(met), "met     0.1 .. 0.5 s  isolated a within 0.25 s (after 100 ms)");
  // It may come and go before; what counts stands at the deadline.
  const ExpectationOutcome flutter = outcome(expectation, {b_, a_, b_, a_, a_, a_});
  EXPECT_TRUE(flutter.is_met);
  EXPECT_NEAR(flutter.delay_s.value(), 0.2, 1e-9);
  EXPECT_EQ(outcome(expectation, {b_, a_, a_, b_, a_, a_}).found,
            "found isolated b at 0.3 s, the deadline");
  EXPECT_EQ(outcome(expectation, {b_, a_, a_, a_, a_, b_}).found, "found isolated b at 0.5 s");
  EXPECT_EQ(outcome(expectation, {b_, b_}).found,
            "found isolated b at 0.1 s, the last sample there");
}

TEST_F(ExpectationWatchTest, ComparesTheSetsOfAnAmbiguousVerdict) {
  Expectation expectation{
      .until_s = 0.0, .verdicts = {Verdict::kAmbiguous}, .sets = {{"a"}, {"b"}}};
  const Answer both{Verdict::kAmbiguous, {1, 2}};
  const Answer more{Verdict::kAmbiguous, {1, 2, 3}};
  EXPECT_TRUE(outcome(expectation, {both}).is_met);
  EXPECT_EQ(outcome(expectation, {more}).found, "found ambiguous a | b | a, b at 0 s");
  EXPECT_FALSE(outcome(expectation, {Answer{Verdict::kAmbiguous, {1, 3}}}).is_met);
  expectation.may_have_more_sets = true;
  EXPECT_TRUE(outcome(expectation, {more}).is_met);
  EXPECT_FALSE(outcome(expectation, {Answer{Verdict::kAmbiguous, {1, 3}}}).is_met);
  expectation.sets.clear();
  EXPECT_TRUE(outcome(expectation, {both}).is_met) << "any will do";
}

TEST_F(ExpectationWatchTest, HearsAFalseAlarmEvenBeforeTheDeadline) {
  const Expectation expectation{
      .until_s = 0.4, .verdicts = {Verdict::kHealthy}, .within_s = 0.3, .has_no_false_alarm = true};
  EXPECT_TRUE(outcome(expectation, {inhibited_, inhibited_, healthy_, healthy_, healthy_}).is_met);
  EXPECT_EQ(outcome(expectation, {inhibited_, a_, healthy_, healthy_, healthy_}).found,
            "false alarm: found isolated a at 0.1 s");
}

TEST_F(ExpectationWatchTest, BlamesTheMessageAndNoOther) {
  const Expectation expectation{.until_s = 0.3,
                                .verdicts = {Verdict::kHealthy, Verdict::kInhibited},
                                .blamed = {"S"},
                                .blamed_faults = {"wrong CRC"}};
  const Answer right{Verdict::kInhibited, {}, MessageFault::kWrongCrc, "S"};
  const Answer other{Verdict::kInhibited, {}, MessageFault::kWrongCrc, "T"};
  const Answer late{Verdict::kInhibited, {}, MessageFault::kLate, "S"};
  EXPECT_TRUE(outcome(expectation, {inhibited_, right, right, healthy_}).is_met);
  EXPECT_EQ(outcome(expectation, {healthy_, right, other}).found,
            "found inhibited (T: wrong CRC) at 0.2 s");
  EXPECT_EQ(outcome(expectation, {right, late}).found, "found inhibited (S: late) at 0.1 s");
  EXPECT_EQ(outcome(expectation, {inhibited_, healthy_}).found, "no message was blamed");
}

TEST_F(ExpectationWatchTest, ComparesTheLastEstimateOfTheStretch) {
  const Expectation expectation{.from_s = 0.1,
                                .until_s = 0.3,
                                .verdicts = {Verdict::kIsolated},
                                .faults = {"a"},
                                .estimates = {{"a", 2.0, 0.25}}};
  // Estimates after the samples, by cycle.
  const auto found_after = [&](const std::map<std::uint32_t, double>& estimates) {
    RunHistory history = history_of(expectation);
    for (std::uint32_t k = 0; k < 6; ++k) {
      history.on_record(record_of(k, a_));
      if (const auto at = estimates.find(k); at != estimates.end()) {
        FaultEstimate estimate;
        estimate.magnitudes.status = EstimateStatus::kValid;
        estimate.magnitudes.faults = {0};
        estimate.magnitudes.value = {at->second};
        estimate.magnitudes.deviation = {0.0};
        estimate.magnitudes.bound = {-1.0};
        history.on_estimate(estimate);
      }
    }
    return history.expectations().front().found;
  };
  EXPECT_EQ(found_after({{1, 7.0}, {3, 2.25}, {4, 7.0}}), "");
  EXPECT_EQ(found_after({{1, 2.0}, {2, 1.7}}), "found a = 1.7 at 0.2 s");
  EXPECT_EQ(found_after({{0, 2.0}, {4, 2.0}}), "found no estimate of a");
}

TEST_F(RunHistoryTest, ListsEachChangeOfTheVerdictOnce) {
  const FaultSchedule schedule(plant_, {});
  RunHistory history(bank_, sets_, {}, schedule);
  std::uint32_t k = 0;
  for (const Verdict verdict : {Verdict::kInhibited, Verdict::kInhibited, Verdict::kHealthy,
                                Verdict::kHealthy, Verdict::kInhibited}) {
    history.on_record(record(k++, verdict));
  }
  ASSERT_EQ(history.verdicts().size(), 3U);
  EXPECT_NEAR(history.verdicts()[1].t_s, 0.2, 1e-9);
}

TEST_F(RunHistoryTest, NamesTheResidualInWhichFaultsCancel) {
  using enum Sensitivity;
  bank_.filters.resize(3);
  const std::vector<std::vector<Sensitivity>> sees = {
      {kSteady, kNone}, {kSteady, kSteady}, {kTransient, kTransient}};
  for (std::size_t i = 0; i < 3; ++i) {
    bank_.filters[i].name = std::vector<std::string>{"ra", "rab", "rt"}[i];
    bank_.filters[i].sees = sees[i];
    bank_.filters[i].M = Eigen::MatrixXd::Ones(1, 1);
  }
  const FaultSchedule schedule(plant_, {});
  RunHistory history(bank_, sets_, {}, schedule);
  DiagnosisRecord found = record(0, Verdict::kIsolated, 3);
  found.decision.cause = Cause::kCancellation;
  history.on_record(found);
  EXPECT_EQ(history.verdicts().back().note, "they cancel in rab");
  found.cycle = 1;
  found.decision.cause = Cause::kTransient;  // no new verdict: the same faults
  history.on_record(found);
  ASSERT_EQ(history.verdicts().size(), 1U);
  EXPECT_EQ(history.verdicts().back().note, "only transients reach rt");
}

TEST_F(RunHistoryTest, TellsWhyASignatureIsUnexplained) {
  bank_.concurrent = 2;
  const FaultSchedule schedule(plant_, {});
  RunHistory history(bank_, sets_, {}, schedule);
  DiagnosisRecord found = record(0, Verdict::kUnexplained);
  found.onset = {.cycle = 0, .filter = 0, .last_cycle = 0};
  found.decision.cause = Cause::kPartial;
  found.decision.set_count = 2;
  found.decision.sets = {1, 2};
  history.on_record(found);
  EXPECT_EQ(verdict_text(history.verdicts().back()), "unexplained");
  EXPECT_EQ(verdict_detail(history.verdicts().back()),
            "partial signature, could be a | b below a threshold; onset 0 s");
  found = record(1, Verdict::kUnexplained);
  found.decision.cause = Cause::kMoreThanP;
  history.on_record(found);
  EXPECT_EQ(verdict_detail(history.verdicts().back()), "more than 2 faults");
}

TEST_F(RunHistoryTest, KeepsTheLastEstimateOfAVerdict) {
  const FaultSchedule schedule(plant_, {});
  RunHistory history(bank_, sets_, {}, schedule);
  history.on_record(record(50, Verdict::kIsolated, 3));
  FaultEstimate estimate;
  history.on_estimate(estimate);
  EXPECT_EQ(verdict_detail(history.verdicts().back()),
            "no estimate: the window does not lie behind the onset yet");
  estimate.magnitudes = {EstimateStatus::kValid, {1, 0}, {-2.0, 0.5}, {0.012, -1.0}, {-1.0, -1.0}};
  estimate.onset_cycle = 40;
  history.on_estimate(estimate);
  EXPECT_EQ(verdict_detail(history.verdicts().back()), "a = 0.5, b = -2.000 +- 0.012; onset 4 s");
  history.on_estimate({});
  EXPECT_EQ(history.verdicts().back().estimates.size(), 2U);
}

TEST_F(RunHistoryTest, TellsAProvedBoundFromADeviation) {
  const FaultSchedule schedule(plant_, {});
  RunHistory history(bank_, sets_, {}, schedule);
  history.on_record(record(50, Verdict::kIsolated, 1));
  FaultEstimate estimate;
  estimate.magnitudes.status = EstimateStatus::kSettling;
  history.on_estimate(estimate);
  EXPECT_EQ(verdict_detail(history.verdicts().back()), "no estimate: settling");
  estimate.magnitudes = {EstimateStatus::kValid, {0}, {0.20312}, {-1.0}, {0.0147}};
  history.on_estimate(estimate);
  EXPECT_EQ(verdict_detail(history.verdicts().back()), "a = 0.203, within 0.015");
  const nlohmann::ordered_json json = verdict_json(history.verdicts().back()).at("estimates").at(0);
  EXPECT_EQ(json.at("bound"), 0.0147);
  EXPECT_TRUE(json.at("deviation").is_null());
}

TEST_F(RunHistoryTest, SaysWhichBiasIsTooSmallToBeIsolated) {
  using enum Sensitivity;
  bank_.filters.resize(3, bank_.filters[0]);
  // On a all must fire but the last, which does not see it at DC.
  const std::vector<std::vector<Sensitivity>> sees = {
      {kSteady, kSteady}, {kSteady, kNone}, {kTransient, kSteady}};
  const std::vector<std::vector<double>> smallest = {{0.8, 0.0}, {1.66, 0.0}, {9.0, 0.0}};
  for (std::size_t i = 0; i < 3; ++i) {
    bank_.filters[i].sees = sees[i];
    bank_.filters[i].certificate.smallest_fault = smallest[i];
  }
  const FaultSchedule schedule(
      plant_, {{.target = "a", .value = -0.4, .at_s = 0.1, .until_s = 0.2},
               {.target = "a", .value = 2.0, .at_s = 0.2},
               {.target = "b", .value = 1e-6, .at_s = 0.1}});  // of b nothing is known
  RunHistory history(bank_, sets_, {}, schedule);
  for (std::uint32_t k = 0; k < 4; ++k) history.on_record(record(k, Verdict::kHealthy));
  ASSERT_EQ(history.injections().size(), 2U);
  ASSERT_EQ(history.injections()[1].small_faults.size(), 0U) << "2 is enough";
  RunHistory shorter(bank_, sets_, {}, schedule);
  for (std::uint32_t k = 0; k < 2; ++k) shorter.on_record(record(k, Verdict::kHealthy));
  ASSERT_EQ(shorter.injections()[1].small_faults.size(), 1U);
  EXPECT_EQ(shorter.injections()[1].small_faults[0].fault, "a");
  EXPECT_EQ(shorter.injections()[1].small_faults[0].value, -0.4);
  EXPECT_EQ(shorter.injections()[1].small_faults[0].smallest, 1.66);
}

TEST(VerdictText, NamesAllCandidates) {
  EXPECT_EQ(verdict_text({1.0, Verdict::kHealthy, {}}), "healthy");
  EXPECT_EQ(verdict_text({.verdict = Verdict::kInhibited}), "inhibited");
  EXPECT_EQ(verdict_text({.verdict = Verdict::kInhibited, .blame = "Sensors1: wrong CRC"}),
            "inhibited (Sensors1: wrong CRC)");
  EXPECT_EQ(verdict_text({1.0, Verdict::kAmbiguous, {{"u1", "u2"}, {"u3", "u4"}}}),
            "ambiguous u1, u2 | u3, u4");
}

}  // namespace
}  // namespace faultline

#include "tools/report/diagnosis_metrics.h"

#include <gmock/gmock.h>

namespace faultline {
namespace {

using testing::ElementsAre;

VerdictStretch verdict(std::int64_t from, std::int64_t until, const std::string& words,
                       std::vector<std::vector<std::string>> sets = {}) {
  VerdictStretch stretch;
  stretch.cycles = {from, until};
  stretch.verdict = words;
  stretch.set_total = static_cast<std::int64_t>(sets.size());
  stretch.sets = std::move(sets);
  return stretch;
}

TEST(TruthStretches, DivideTheRunWhereTheSetOfFaultsChanges) {
  const std::vector<RecordedFault> faults{{"u2", "bias", 2.0, 10, 40},
                                          {"u1", "gain", 0.5, 20, std::nullopt},
                                          {"u1", "bias", 1.0, 30, 35}};
  const auto stretches = truth_stretches(faults, {0, 50});
  ASSERT_EQ(stretches.size(), 4U);
  EXPECT_THAT(stretches[0].faults, ElementsAre());
  EXPECT_THAT(stretches[1].faults, ElementsAre("u2"));
  EXPECT_EQ(stretches[2].cycles.from, 20);
  EXPECT_EQ(stretches[2].cycles.until, 40);
  EXPECT_THAT(stretches[2].faults, ElementsAre("u1", "u2"));
  EXPECT_THAT(stretches[3].faults, ElementsAre("u1"));
  EXPECT_EQ(stretches[3].cycles.until, 50);
}

TEST(TruthStretches, AFaultOfFramesIsNoneOfThePlant) {
  const auto stretches = truth_stretches({{"Sensors1", "wrong_crc", 0.0, 10, 20}}, {0, 50});
  ASSERT_EQ(stretches.size(), 1U);
  EXPECT_THAT(stretches[0].faults, ElementsAre());
}

// 100 cycles: u1 acts in 40 .. 79. Counted by hand:
//   0 .. 9 inhibited, 10 .. 19 healthy, 20 .. 24 a false alarm, 25 .. 49 healthy,
//   50 .. 59 ambiguous with u1 among two, 60 .. 84 isolated u1, 85 .. 99 healthy.
class HandComputed : public testing::Test {
 protected:
  const DiagnosisMetrics metrics_ =
      diagnosis_metrics(truth_stretches({{"u1", "bias", 1.0, 40, 80}}, {0, 100}),
                        {verdict(0, 10, "inhibited"), verdict(10, 20, "healthy"),
                         verdict(20, 25, "isolated", {{"u3"}}), verdict(25, 50, "healthy"),
                         verdict(50, 60, "ambiguous", {{"u1"}, {"u2"}}),
                         verdict(60, 85, "isolated", {{"u1"}}), verdict(85, 100, "healthy")});
};

TEST_F(HandComputed, Rates) {
  EXPECT_EQ(metrics_.faulty_cycles, 40);
  EXPECT_DOUBLE_EQ(*metrics_.true_detection_rate(), 30.0 / 40.0);
  EXPECT_DOUBLE_EQ(*metrics_.missed_detection_rate(), 10.0 / 40.0);
  // 60 cycles without a fault, 10 of them inhibited; 5 of the false alarm, 5 after the fault's end.
  EXPECT_DOUBLE_EQ(*metrics_.false_alarm_rate(), 10.0 / 50.0);
  EXPECT_EQ(metrics_.clearing_cycles, 5);
  EXPECT_EQ(metrics_.false_alarms, 1U);
  EXPECT_DOUBLE_EQ(*metrics_.fault_isolation_accuracy(), (20.0 + 10.0 / 2.0) / 30.0);
  EXPECT_EQ(metrics_.inhibited_cycles, 10);
}

TEST_F(HandComputed, Delays) {
  ASSERT_EQ(metrics_.outcomes.size(), 1U);
  EXPECT_EQ(metrics_.outcomes[0].detection_delay, 10);
  EXPECT_EQ(metrics_.outcomes[0].isolation_delay, 20);
  EXPECT_EQ(metrics_.missed_faults, 0U);
}

TEST_F(HandComputed, Confusion) {
  EXPECT_EQ(metrics_.confusion.at("u1").at("isolated u1"), 20);
  EXPECT_EQ(metrics_.confusion.at("u1").at("ambiguous"), 10);
  EXPECT_EQ(metrics_.confusion.at("u1").at("healthy"), 10);
  EXPECT_EQ(metrics_.confusion.at("none").at("isolated u3"), 5);
  EXPECT_EQ(metrics_.confusion.at("none").at("isolated u1"), 5);
  EXPECT_EQ(metrics_.confusion.at("none").at("healthy"), 10 + 15 + 15);
}

TEST(DiagnosisMetrics, AnAlarmFromBeforeDoesNotDetectANewFault) {
  // u1 from 10 on, u2 as well from 50 on; isolated u1 stands until 60.
  const auto metrics = diagnosis_metrics(
      truth_stretches(
          {{"u1", "bias", 1.0, 10, std::nullopt}, {"u2", "bias", 1.0, 50, std::nullopt}}, {0, 100}),
      {verdict(0, 12, "healthy"), verdict(12, 60, "isolated", {{"u1"}}),
       verdict(60, 100, "isolated", {{"u1", "u2"}})});
  ASSERT_EQ(metrics.outcomes.size(), 2U);
  EXPECT_EQ(metrics.outcomes[0].detection_delay, 2);
  EXPECT_EQ(metrics.outcomes[1].detection_delay, 10);
  EXPECT_EQ(metrics.outcomes[1].isolation_delay, 10);
}

TEST(DiagnosisMetrics, AMissedFaultIsCounted) {
  const auto metrics = diagnosis_metrics(truth_stretches({{"u1", "bias", 0.1, 10, 20}}, {0, 30}),
                                         {verdict(0, 30, "healthy")});
  EXPECT_EQ(metrics.missed_faults, 1U);
  EXPECT_DOUBLE_EQ(*metrics.true_detection_rate(), 0.0);
  EXPECT_FALSE(metrics.fault_isolation_accuracy().has_value());
  EXPECT_FALSE(metrics.outcomes[0].detection_delay.has_value());
}

TEST(DiagnosisMetrics, NothingToCountGivesNoRates) {
  const DiagnosisMetrics metrics = diagnosis_metrics({}, {});
  EXPECT_FALSE(metrics.true_detection_rate().has_value());
  EXPECT_FALSE(metrics.false_alarm_rate().has_value());
}

}  // namespace
}  // namespace faultline

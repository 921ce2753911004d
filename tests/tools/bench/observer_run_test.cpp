// What a run says of observers: thresholds of each sample, estimates with a proved bound.

#include <cmath>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include <faultline/estimate_t.hpp>
#include <faultline/residual_t.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/evaluator.h"
#include "diagnosis/runtime/onset.h"
#include "diagnosis/runtime/residual_bank.h"
#include "sim/fault_schedule.h"
#include "tests/diagnosis/observer_bank.h"
#include "tools/bench/run_history.h"
#include "tools/bench/run_publisher.h"
#include "tools/lcm/channels.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

/// Keeps the messages of two channels.
class CapturingSink final : public MessageSink {
 public:
  struct Captured {
    std::vector<residual_t> residuals;
    std::vector<estimate_t> estimates;
  };
  explicit CapturingSink(Captured& captured) : captured_(captured) {}

  void publish(const char* channel, std::int64_t /*utime*/,
               std::span<const std::uint8_t> message) override {
    if (std::string_view(channel) == kResidualChannel) {
      decode(message, captured_.residuals.emplace_back());
    } else if (std::string_view(channel) == kEstimateChannel) {
      decode(message, captured_.estimates.emplace_back());
    }
  }
  void flush() override {}
  void close() override {}

 private:
  template <class Message>
  static void decode(std::span<const std::uint8_t> bytes, Message& message) {
    ASSERT_GT(message.decode(bytes.data(), 0, static_cast<int>(bytes.size())), 0);
  }
  Captured& captured_;
};

/// A diagnosis of the observers' plant without a bus: what DiagnosisNode does with each sample.
class ObserverRun {
 public:
  ObserverRun()
      : inputs_{.name = "observers", .bank = observer_bank(), .map = {}, .parts = {}},
        filters_(inputs_.bank),
        evaluator_(inputs_.bank),
        table_(inputs_.bank),
        settling_(inputs_.bank.decision, 1),
        onset_(1),
        publisher_(inputs_, table_.sets(), std::make_unique<CapturingSink>(captured), nullptr),
        history_(inputs_.bank, table_.sets(), no_scenario_, no_faults_),
        record_(inputs_.bank) {}

  void run_to(std::uint32_t last) {
    for (; record_.cycle <= last; ++record_.cycle) {
      const std::vector<double> u = {0.0};
      filters_.step(plant.y(), u);
      plant.step(0.0);
      evaluator_.step(filters_.evaluation(), filters_.thresholds());
      const Decision decision = table_.decide(evaluator_.signature(), evaluator_.persistent());
      record_.decision = settling_.step(decision, evaluator_.signature());
      record_.onset = onset_.step(settling_, evaluator_, record_.cycle);
      record_.residual.assign(filters_.residual().begin(), filters_.residual().end());
      record_.evaluation.assign(filters_.evaluation().begin(), filters_.evaluation().end());
      record_.thresholds.assign(filters_.thresholds().begin(), filters_.thresholds().end());
      record_.row_thresholds.assign(filters_.row_thresholds().begin(),
                                    filters_.row_thresholds().end());
      record_.fired.assign(evaluator_.fired().begin(), evaluator_.fired().end());
      const FaultEstimate* const estimate = publisher_.publish_record(record_, record_.cycle);
      history_.on_record(record_);
      if (estimate != nullptr) history_.on_estimate(*estimate);
    }
  }

  ObservedPlant plant;
  CapturingSink::Captured captured;
  [[nodiscard]] const RunHistory& history() const { return history_; }

 private:
  DiagnosisInputs inputs_;
  Scenario no_scenario_;
  FaultSchedule no_faults_;
  ResidualBank filters_;
  Evaluator evaluator_;
  DecisionTable table_;
  Settling settling_;
  OnsetTracker onset_;
  RunPublisher publisher_;
  RunHistory history_;
  DiagnosisRecord record_;
};

TEST(ObserverRun, PublishesTheThresholdsOfEachSample) {
  ObserverRun run;
  run.run_to(5);
  ASSERT_EQ(run.captured.residuals.size(), 6U);
  EXPECT_THAT(run.captured.residuals[0].threshold, ElementsAre(1.0, 0.2));
  EXPECT_THAT(run.captured.residuals[1].threshold, ElementsAre(1.0, 0.05));
  EXPECT_THAT(run.captured.residuals[5].threshold, ElementsAre(1.0, 0.02));
  EXPECT_THAT(run.captured.residuals[0].row_threshold, ElementsAre(0.2, 0.1, 0.2));
  EXPECT_THAT(run.captured.residuals[5].row_threshold, ElementsAre(0.004, 0.004, 0.02));
}

TEST(ObserverRun, EstimatesASensorFaultWithinItsBoundOnceItHasSettled) {
  ObserverRun run;
  run.run_to(49);
  run.plant.f_y1 = 0.2;
  run.run_to(399);
  // Isolated with sample 61, after detection cleared with 58 and 59; 8 samples on, once a second.
  std::vector<std::int64_t> cycles;
  for (const estimate_t& estimate : run.captured.estimates) cycles.push_back(estimate.cycle);
  EXPECT_THAT(cycles, ElementsAre(61, 66, 100, 200, 300));
  EXPECT_EQ(run.captured.estimates[0].reason, "settling");
  EXPECT_EQ(run.captured.estimates[0].fault_count, 0);
  for (std::size_t i = 1; i < run.captured.estimates.size(); ++i) {
    const estimate_t& estimate = run.captured.estimates[i];
    EXPECT_EQ(estimate.reason, "");
    EXPECT_THAT(estimate.fault, ElementsAre("y1"));
    EXPECT_THAT(estimate.bound, ElementsAre(0.015));
    EXPECT_THAT(estimate.deviation, ElementsAre(MagnitudeEstimate::kUnknown));
    EXPECT_LE(std::abs(estimate.estimate.at(0) - 0.2), 0.015);
    EXPECT_EQ(estimate.onset_cycle, 50);
  }
  const VerdictEntry& verdict = run.history().verdicts().back();
  EXPECT_EQ(verdict_text(verdict), "isolated y1");
  EXPECT_EQ(verdict_detail(verdict),
            "y1 = 0.200, within 0.015; only transients reach detection; onset 0.5 s");
}

TEST(ObserverRun, EstimatesOtherFaultsFromTheWindowAsBefore) {
  ObserverRun run;
  run.run_to(49);
  run.plant.f_u = 0.2;
  run.run_to(399);
  ASSERT_FALSE(run.captured.estimates.empty());
  const estimate_t& first = run.captured.estimates.front();
  EXPECT_EQ(first.cycle, 64);
  EXPECT_THAT(first.reason, HasSubstr("window"));
  const estimate_t& last = run.captured.estimates.back();
  ASSERT_THAT(last.fault, ElementsAre("u"));
  EXPECT_THAT(last.bound, ElementsAre(MagnitudeEstimate::kUnknown));
  // The window's filters are linear, the plant is not quite.
  EXPECT_NEAR(last.estimate.at(0), 0.2, 0.02);
}

}  // namespace
}  // namespace faultline

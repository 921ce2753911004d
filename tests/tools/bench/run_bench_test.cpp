#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>

#include <faultline/diagnosis_t.hpp>
#include <faultline/estimate_t.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/design/design_bank.h"
#include "sim/static_feedback.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"
#include "tools/bench/run_summary.h"
#include "tools/lcm/channels.h"
#include "tools/log/log_info.h"

namespace faultline {
namespace {

using testing::ElementsAre;

const std::filesystem::path kDemo =
    std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015" / "demo.toml";

BenchResult run_demo(const BenchInputs& inputs, const std::filesystem::path& log,
                     bool is_realtime = false) {
  BenchOptions options;
  options.bus = "loop";
  options.is_realtime = is_realtime;
  options.log = log;
  return run_bench(inputs, options);
}

TEST(RunBench, GivesTheSameBitsEachTimeInLockStep) {
  const BenchInputs inputs = load_bench_inputs(kDemo);
  const TemporaryFolder folder;
  run_demo(inputs, folder.path() / "a.lcm");
  run_demo(inputs, folder.path() / "b.lcm");
  const auto a = logged_residuals(folder.path() / "a.lcm");
  const auto b = logged_residuals(folder.path() / "b.lcm");
  EXPECT_EQ(a.size(), 1001U);
  EXPECT_EQ(b.size(), 1001U);
  EXPECT_EQ(first_difference(a, b), 1001U);
}

TEST(RunBench, DiagnosesTwoSimultaneousFaultsInRealTime) {
  BenchInputs inputs = load_bench_inputs(kDemo);
  inputs.scenario.duration_s = 2.5;
  inputs.scenario.expectations.clear();
  for (Injection& injection : inputs.scenario.injections) injection.at_s = 2.0;
  inputs.schedule = FaultSchedule(inputs.plant, inputs.scenario.injections);
  const TemporaryFolder folder;
  const BenchResult result = run_demo(inputs, folder.path() / "run.lcm", true);
  EXPECT_EQ(result.counters.cycles, 251U);
  EXPECT_EQ(result.counters.frames_received, result.counters.frames_sent);
  EXPECT_EQ(result.counters.records_dropped, 0U);
  EXPECT_GE(result.wall_s, 2.5);
  ASSERT_FALSE(result.history.verdicts().empty());
  EXPECT_EQ(verdict_text(result.history.verdicts().back()), "isolated u2, u3");
}

TEST(RunBench, WritesALogThatTellsEverything) {
  const BenchInputs inputs = load_bench_inputs(kDemo);
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "run.lcm";
  const BenchResult result = run_demo(inputs, file);
  const LogInfo info = read_log_info({file.string()});
  EXPECT_EQ(info.undecodable, 0U);
  EXPECT_NEAR(info.duration_s, 10.0, 1e-6);
  EXPECT_EQ(info.channels.at("FAULTLINE_SAMPLE").messages, 1001U);
  EXPECT_EQ(info.channels.at("FAULTLINE_RESIDUAL").messages, 1001U);
  EXPECT_EQ(info.channels.at("FAULTLINE_STATS").messages, 12U);
  for (const auto& [name, channel] : info.channels) EXPECT_EQ(channel.missing, 0U) << name;
  ASSERT_EQ(info.parts.size(), inputs.parts.size());
  for (const LogInfo::Part& part : info.parts) EXPECT_TRUE(part.is_complete) << part.part;
  ASSERT_FALSE(info.verdicts.empty());
  EXPECT_EQ(info.verdicts.back().verdict, "isolated");
  EXPECT_THAT(info.verdicts.back().sets, ElementsAre(ElementsAre("u2", "u3")));
  EXPECT_EQ(info.verdicts.back().cause, "complete");
  ASSERT_EQ(info.verdicts.back().estimates.size(), 2U);
  EXPECT_EQ(info.verdicts.back().estimates[1].fault, "u3");
  EXPECT_NEAR(static_cast<double>(info.verdicts.back().onset_cycle), 400.0, 1.0);
  ASSERT_EQ(info.verdicts.size(), result.history.verdicts().size());
}

TEST(RunBench, EstimatesWhatWasInjectedAndWhen) {
  const BenchInputs inputs = load_bench_inputs(kDemo);  // u2, u3 = 2 from cycle 400 on
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "run.lcm";
  run_demo(inputs, file);
  const auto estimates = logged_messages<estimate_t>(file, kEstimateChannel);
  const auto diagnoses = logged_messages<diagnosis_t>(file, kDiagnosisChannel);
  int valid = 0;
  std::int64_t first_valid = 0;
  for (const estimate_t& estimate : estimates) {
    if (estimate.fault_count == 0) {
      EXPECT_EQ(valid, 0);
      EXPECT_EQ(estimate.reason, "the window does not lie behind the onset yet");
      continue;
    }
    if (++valid == 1) first_valid = estimate.cycle;
    EXPECT_EQ(estimate.reason, "");
    EXPECT_THAT(estimate.fault, ElementsAre("u2", "u3"));
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_NEAR(estimate.estimate[i], 2.0, 3.0 * estimate.deviation[i]);
      EXPECT_GT(estimate.deviation[i], 0.0);
      EXPECT_LT(estimate.bound[i], 0.0);
    }
    EXPECT_NEAR(static_cast<double>(estimate.onset_cycle), 400.0, 1.0);
  }
  // With the DIAGNOSIS of each second from 5 s on, and once as soon as the window was full.
  EXPECT_EQ(valid, 7);
  EXPECT_EQ(diagnoses.back().cause, "complete");
  EXPECT_GE(diagnoses.back().onset_cycle, 400);
  EXPECT_LE(first_valid, diagnoses.back().since_cycle + inputs.bank.decision.window);
  EXPECT_EQ(diagnoses.front().onset_cycle, -1);
}

TEST(RunBench, EstimatesWithinItsDeviationWhereTheBankIsDesignedOnTheSampledPlant) {
  BenchInputs inputs = load_bench_inputs(kDemo);
  BankRequest request = read_bank_request(kDemo.parent_path() / "bank.toml");
  request.domain = DesignDomain::kSampled;
  request.poles = {std::exp(-10.0 * request.sample_time_s)};
  inputs.bank = design_bank(inputs.plant, request).bank;
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "run.lcm";
  run_demo(inputs, file);
  int valid = 0;
  for (const estimate_t& estimate : logged_messages<estimate_t>(file, kEstimateChannel)) {
    for (std::size_t i = 0; i < estimate.fault.size(); ++i) {
      ++valid;
      EXPECT_NEAR(estimate.estimate[i], 2.0, 3.0 * estimate.deviation[i]) << estimate.cycle;
      EXPECT_LT(estimate.deviation[i], 1e-3);
    }
  }
  EXPECT_EQ(valid, 14);
}

TEST(RunBench, GivesASecondFaultItsOwnOnsetAndSize) {
  const BenchInputs inputs = load_bench_inputs(kDemo.parent_path() / "fig15.toml");
  const TemporaryFolder folder;
  const BenchResult result = run_demo(inputs, folder.path() / "run.lcm");  // u1 at 50 s, u3 at 70 s
  std::vector<VerdictEntry> isolated;
  for (const VerdictEntry& entry : result.history.verdicts()) {
    if (entry.verdict == Verdict::kIsolated) isolated.push_back(entry);
  }
  ASSERT_EQ(isolated.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(isolated[i].onset_s.value(), i == 0 ? 50.0 : 70.0, inputs.bank.sample_time_s);
    ASSERT_EQ(isolated[i].estimates.size(), i + 1);
    for (const EstimateEntry& estimate : isolated[i].estimates) {
      EXPECT_NEAR(estimate.value, 2.0, 3.0 * estimate.deviation) << estimate.fault;
    }
  }
}

TEST(RunBench, SaysThatASignatureIsPartialAndWhoseItCouldBe) {
  const BenchInputs inputs = load_bench_inputs(kDemo.parent_path() / "marginal_1.toml");
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "run.lcm";
  const BenchResult result = run_demo(inputs, file);
  const VerdictEntry& last = result.history.verdicts().back();
  EXPECT_EQ(last.cause, Cause::kPartial);
  EXPECT_THAT(last.sets, ElementsAre(ElementsAre("u1"), ElementsAre("u4")));
  const diagnosis_t message = logged_messages<diagnosis_t>(file, kDiagnosisChannel).back();
  EXPECT_EQ(message.cause, "partial");
  EXPECT_EQ(message.set_total, 2);
  EXPECT_TRUE(logged_messages<estimate_t>(file, kEstimateChannel).empty());
}

std::string summary_text(const BenchInputs& inputs, const BenchResult& result) {
  BenchOptions options;
  options.bus = "loop";
  std::FILE* file = std::tmpfile();
  print_summary(file, inputs, options, result);
  std::string text(static_cast<std::size_t>(std::ftell(file)), '\0');
  std::rewind(file);
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  return text;
}

TEST(RunBench, SaysThatAnInjectedBiasIsTooSmallToBeIsolated) {
  BenchInputs inputs = load_bench_inputs(kDemo.parent_path() / "fig06.toml");  // u1 = 0.4
  for (ResidualFilter& filter : inputs.bank.filters) {
    filter.certificate.smallest_fault.assign(4, 0.0);
  }
  const TemporaryFolder folder;
  const std::string unknown = summary_text(inputs, run_demo(inputs, folder.path() / "unknown.lcm"));
  EXPECT_THAT(unknown, testing::Not(testing::HasSubstr("is below")));
  for (ResidualFilter& filter : inputs.bank.filters) {
    if (filter.sees[0] == Sensitivity::kSteady) filter.certificate.smallest_fault[0] = 1.66;
  }
  const std::string known = summary_text(inputs, run_demo(inputs, folder.path() / "known.lcm"));
  EXPECT_THAT(known, testing::HasSubstr("u1 0.4 is below 1.66, the smallest that is isolated"));
}

TEST(RunBench, StopsWhenThePlantDivergesAndSaysWhere) {
  BenchInputs inputs = load_bench_inputs(kDemo);
  inputs.make_controller = [&inputs] {
    return std::make_unique<StaticFeedback>(
        open_loop(inputs.plant, Eigen::VectorXd::Ones(inputs.plant.m())));
  };
  inputs.scenario.duration_s = 1e4;
  BenchOptions options;
  options.bus = "loop";
  const BenchResult result = run_bench(inputs, options);
  ASSERT_TRUE(result.stop_reason.has_value());
  EXPECT_EQ(result.stop_reason->kind, StopReason::Kind::kPlant);
  EXPECT_THAT(result.stop_reason->text, testing::HasSubstr("diverged"));
}

TEST(RunBench, RefusesABusItDoesNotKnow) {
  const BenchInputs inputs = load_bench_inputs(kDemo);
  BenchOptions options;
  options.bus = "flexray:0";
  EXPECT_THROW(static_cast<void>(run_bench(inputs, options)), std::invalid_argument);
}

TEST(OpenLog, NeverReplacesAFileThatIsNoLog) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "notes.txt";
  std::FILE* out = std::fopen(file.c_str(), "w");
  ASSERT_NE(out, nullptr);
  std::fputs("precious", out);
  std::fclose(out);
  EXPECT_THROW(static_cast<void>(open_log(file)), std::invalid_argument);
  EXPECT_EQ(std::filesystem::file_size(file), 8U);
}

TEST(OpenLog, SaysThatTheDiskIsFull) {
  const auto log = open_log("/dev/full");
  const std::vector<std::uint8_t> message(1024);
  EXPECT_THROW(
      {
        for (int i = 0; i < 1000; ++i) log->publish("X", i, message);
        log->close();
      },
      MessageSinkError);
}

}  // namespace
}  // namespace faultline

#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"
#include "tools/replay/log_info.h"

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
  const LogInfo info = read_log_info(file);
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
  ASSERT_EQ(info.verdicts.size(), result.history.verdicts().size());
}

TEST(RunBench, StopsWhenThePlantDivergesAndSaysWhere) {
  BenchInputs inputs = load_bench_inputs(kDemo);
  inputs.control_law = open_loop(inputs.plant, Eigen::VectorXd::Ones(inputs.plant.m()));
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

// Whole runs in which frames are lost, late, doubled, changed, or a node is off the bus: the
// examples of examples/hou2015/bus_faults, and timelines drawn at random.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <faultline/can_t.hpp>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/support/random_seed.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"
#include "tools/bench/run_summary.h"
#include "tools/lcm/channels.h"

namespace faultline {
namespace {

using testing::HasSubstr;
using enum InjectionKind;

const std::filesystem::path kExamples = std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015";
const std::filesystem::path kBusFaults = kExamples / "bus_faults";

std::vector<std::string> example_names() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(kBusFaults)) {
    if (entry.path().extension() == ".toml") names.push_back(entry.path().stem().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

BenchResult run(const BenchInputs& inputs, const std::filesystem::path& log = {}) {
  BenchOptions options;
  options.bus = "loop";
  if (!log.empty()) options.log = log;
  return run_bench(inputs, options);
}

std::string outcome_of(const BenchResult& result) {
  std::string text;
  for (const VerdictEntry& entry : result.history.verdicts()) {
    text += fmt::format("{} s {}; ", entry.t_s, verdict_text(entry));
  }
  return text;
}

/// Bytes of every frame that the diagnosis received, in order.
std::vector<std::vector<std::uint8_t>> logged_frames(const std::filesystem::path& log) {
  std::vector<std::vector<std::uint8_t>> found;
  for (const can_t& batch : logged_messages<can_t>(log, kCanChannel)) {
    for (const can_frame_t& frame : batch.frames) {
      const auto id = static_cast<std::uint32_t>(frame.id);
      found.emplace_back(frame.data.begin(), frame.data.end());
      for (int shift = 0; shift < 32; shift += 8) {
        found.back().push_back(static_cast<std::uint8_t>(id >> shift));
      }
    }
  }
  return found;
}

class BusFaults : public testing::TestWithParam<std::string> {};

TEST_P(BusFaults, MeetsItsExpectationsAndRepeatsToTheBit) {
  const BenchInputs inputs = load_bench_inputs(kBusFaults / (GetParam() + ".toml"));
  ASSERT_FALSE(inputs.scenario.expectations.empty());
  const TemporaryFolder folder;
  const BenchResult result = run(inputs, folder.path() / "a.lcm");
  EXPECT_FALSE(result.stop_reason.has_value()) << result.stop_reason->text;
  EXPECT_EQ(result.counters.cycles, 801U);
  EXPECT_TRUE(result.history.are_expectations_met()) << outcome_of(result);
  // Nobody waited for what does not come: 2 s each time (kAnswerTimeout).
  EXPECT_LT(result.wall_s, 2.0);

  static_cast<void>(run(inputs, folder.path() / "b.lcm"));
  const auto residuals = logged_residuals(folder.path() / "a.lcm");
  EXPECT_EQ(first_difference(residuals, logged_residuals(folder.path() / "b.lcm")),
            residuals.size());
  EXPECT_EQ(logged_frames(folder.path() / "a.lcm"), logged_frames(folder.path() / "b.lcm"));
}

INSTANTIATE_TEST_SUITE_P(Examples, BusFaults, testing::ValuesIn(example_names()),
                         [](const auto& example) { return example.param; });

TEST(BusFaultExamples, ShowEveryKind) {
  std::vector<InjectionKind> shown;
  for (const std::string& name : example_names()) {
    const Scenario scenario = read_scenario(kBusFaults / (name + ".toml"));
    for (const Injection& injection : scenario.injections) shown.push_back(injection.kind);
  }
  for (const InjectionKind kind : all_injection_kinds()) {
    if (level_of(kind) == FaultLevel::kPlant) continue;
    EXPECT_THAT(shown, testing::Contains(kind)) << injection_kind_name(kind);
  }
}

TEST(FrameFaultRun, AnotherSeedDrawsOtherFrames) {
  BenchInputs inputs = load_bench_inputs(kBusFaults / "intermittent.toml");
  const TemporaryFolder folder;
  static_cast<void>(run(inputs, folder.path() / "a.lcm"));
  inputs.schedule = FaultSchedule(inputs.schedule.targets(), inputs.scenario.injections, 2);
  static_cast<void>(run(inputs, folder.path() / "b.lcm"));
  EXPECT_NE(logged_frames(folder.path() / "a.lcm"), logged_frames(folder.path() / "b.lcm"));
}

TEST(FrameFaultRun, TellsInTheSummaryWhatFaultsDidToFrames) {
  const BenchInputs inputs = load_bench_inputs(kBusFaults / "dropped.toml");
  const BenchResult result = run(inputs);
  EXPECT_EQ(result.counters.frame_faults.dropped, 50U);
  EXPECT_EQ(result.counters.frames_sent, 801U * 5U - 50U - 2U * 50U);  // nor the two answers
  std::FILE* const file = std::tmpfile();
  ASSERT_NE(file, nullptr);
  print_summary(file, inputs, {.bus = "loop"}, result);
  std::string text(static_cast<std::size_t>(std::ftell(file)), '\0');
  std::rewind(file);
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  EXPECT_THAT(text, HasSubstr("  faults   frames dropped 50, changed 0, late 0, added 0\n"));
  const auto json = summary_json(inputs, {.bus = "loop"}, result);
  EXPECT_EQ(json["frame_faults"]["dropped"], 50);
}

TEST(FrameFaultRun, PlantAndControllerMayBothBeOffTheBusForLongerThanTheDiagnosisWaits) {
  BenchInputs inputs = load_bench_inputs(kBusFaults / "bus_off_plant.toml");
  inputs.scenario.expectations.clear();
  std::vector<Injection> injections;
  for (const char* node : {"plant", "controller"}) {
    injections.push_back({.target = node, .kind = kBusOff, .at_s = 3.0, .until_s = 4.5});
  }
  inputs.schedule = FaultSchedule(inputs.schedule.targets(), injections, 1);
  const BenchResult result = run(inputs);
  EXPECT_FALSE(result.stop_reason.has_value());
  EXPECT_EQ(result.counters.cycles, 801U);
  EXPECT_EQ(result.counters.resets, 1U);  // a gap of more than 100 cycles
  EXPECT_EQ(result.counters.frame_faults.dropped, 150U * 3U);
  EXPECT_EQ(verdict_text(result.history.verdicts().back()), "healthy");
}

// --- Real time: the same faults at the same cycles.

BenchResult run_in_real_time(const char* example, double duration_s,
                             std::vector<Injection> injections) {
  BenchInputs inputs = load_bench_inputs(kBusFaults / (std::string(example) + ".toml"));
  inputs.scenario.expectations.clear();
  inputs.scenario.duration_s = duration_s;
  inputs.schedule = FaultSchedule(inputs.schedule.targets(), std::move(injections), 1);
  BenchOptions options;
  options.bus = "loop";
  options.is_realtime = true;
  return run_bench(inputs, options);
}

TEST(FrameFaultRun, ActsInRealTimeToo) {
  const BenchResult result = run_in_real_time(
      "dropped", 1.0,
      {{.target = "Sensors1", .kind = kDropped, .at_s = 0.2, .until_s = 0.3},
       {.target = "Sensors2", .kind = kDelayed, .value = 3.0, .at_s = 0.4, .until_s = 0.5},
       {.target = "Commands1", .kind = kDelayed, .value = 2.0, .at_s = 0.6, .until_s = 0.7},
       {.target = "Sync", .kind = kBabbling, .value = 20.0, .at_s = 0.8, .until_s = 0.9}});
  EXPECT_FALSE(result.stop_reason.has_value());
  EXPECT_EQ(result.counters.cycles, 101U);
  EXPECT_EQ(result.counters.frame_faults.dropped, 10U);
  EXPECT_EQ(result.counters.frame_faults.added, 200U);
  EXPECT_GE(result.counters.frame_faults.late, 10U);
  EXPECT_LE(result.counters.frame_faults.late, 20U);  // of commands, those of late answers lack
  EXPECT_EQ(result.messages[0].integrity.lost, 10U);
  EXPECT_EQ(result.messages[4].too_short, 200U);
}

TEST(FrameFaultRun, CyclesGoOnInRealTimeWhileANodeIsOffTheBus) {
  const BenchResult result =
      run_in_real_time("bus_off_plant", 1.0,
                       {{.target = "plant", .kind = kBusOff, .at_s = 0.2, .until_s = 0.4},
                        {.target = "controller", .kind = kBusOff, .at_s = 0.6, .until_s = 0.8}});
  EXPECT_FALSE(result.stop_reason.has_value());
  EXPECT_EQ(result.counters.cycles, 101U);
  EXPECT_EQ(result.messages[4].integrity.frames, 81U);
  // The plant heard nothing for 20 cycles and got no answer for 20.
  EXPECT_GE(result.counters.late_cycles, 38U);
  EXPECT_LT(result.counters.late_cycles, 60U);
}

// --- Timelines drawn at random.

/// Faults of frames between 1.5 s and 4 s. Corruptions are such that a CRC-8 of polynomial 0x1D
/// is certain to find them: up to three bits.
class RandomTimeline {
 public:
  /// Delays of one message add up, of up to a second each: in all, no frame is later than this.
  static constexpr std::size_t kMostDelays = 2;

  RandomTimeline(std::uint64_t seed, const FaultTargets& targets)
      : draw_(seed), targets_(&targets) {}

  std::vector<Injection> operator()() {
    std::vector<Injection> injections;
    const std::size_t count = 1 + draw_() % 6;
    std::size_t delays = 0;
    while (injections.size() < count) {
      const Injection drawn = one();
      delays += drawn.kind == kDelayed ? 1U : 0U;
      if (drawn.kind != kDelayed || delays <= kMostDelays) injections.push_back(drawn);
    }
    return injections;
  }

 private:
  double between(double least, double most) {
    return std::uniform_real_distribution<double>(least, most)(draw_);
  }

  Injection one() {
    static constexpr std::array kKinds{kDropped,   kDelayed,  kDuplicated,    kReordered,
                                       kCorrupted, kWrongCrc, kFrozenCounter, kWrongDlc,
                                       kBabbling,  kBusOff};
    Injection injection;
    injection.kind = kKinds[draw_() % kKinds.size()];
    injection.target = targets_->messages[draw_() % targets_->messages.size()].name;
    injection.at_s = between(1.5, 3.5);
    injection.until_s = injection.at_s + between(0.02, 0.5);
    if (draw_() % 2 == 0) injection.probability = between(0.05, 1.0);
    if (draw_() % 4 == 0) injection.period_s = between(0.03, 0.3);
    switch (injection.kind) {
      case kDelayed:
        injection.value = static_cast<double>(1 + draw_() % 100);
        break;
      case kDuplicated:
      case kBabbling:
        injection.value = static_cast<double>(1 + draw_() % 5);
        break;
      case kCorrupted:
        injection.value = static_cast<double>(1 + draw_() % 3);
        break;
      case kBusOff:
        injection.target = draw_() % 2 == 0 ? "plant" : "controller";
        injection.probability = 1.0;
        break;
      default:
        break;
    }
    return injection;
  }

  std::mt19937_64 draw_;
  const FaultTargets* targets_;
};

std::string text_of(const std::vector<Injection>& injections) {
  std::string text;
  for (const Injection& one : injections) {
    text += fmt::format("{} {} v={} {}..{} s p={} period={}\n", one.target,
                        injection_kind_name(one.kind), one.value.value_or(NAN), one.at_s,
                        one.until_s.value_or(NAN), one.probability, one.period_s.value_or(NAN));
  }
  return text;
}

TEST(FrameFaultRun, NoTimelineOfFrameFaultsLooksLikeAFaultOfTheHealthyPlant) {
  const std::uint64_t seed = test_seed(700);
  SCOPED_TRACE(seed_message(seed));
  BenchInputs inputs = load_bench_inputs(kBusFaults / "dropped.toml");
  inputs.scenario.expectations.clear();
  std::uint64_t bad_samples = 0;
  std::uint64_t disturbed = 0;
  for (std::uint64_t round = 0; round < 200; ++round) {
    const std::vector<Injection> injections =
        RandomTimeline(seed + round, inputs.schedule.targets())();
    SCOPED_TRACE(fmt::format("round {}\n{}", round, text_of(injections)));
    inputs.schedule =
        FaultSchedule(inputs.schedule.targets(), injections, static_cast<std::int64_t>(round));
    const BenchResult result = run(inputs);
    ASSERT_FALSE(result.stop_reason.has_value()) << result.stop_reason->text;
    EXPECT_LT(result.wall_s, 2.0);
    ASSERT_EQ(result.counters.cycles, 801U);
    bad_samples += result.counters.bad_samples;
    disturbed += result.counters.frame_faults.is_clean() ? 0U : 1U;
    for (const VerdictEntry& entry : result.history.verdicts()) {
      EXPECT_TRUE(entry.verdict == Verdict::kHealthy || entry.verdict == Verdict::kInhibited)
          << verdict_text(entry) << " at " << entry.t_s << " s";
    }
    // What the last frame did is forgotten in 1.3 s.
    const VerdictEntry& last = result.history.verdicts().back();
    EXPECT_EQ(verdict_text(last), "healthy");
    EXPECT_LT(last.t_s, 4.0 + 1.0 * RandomTimeline::kMostDelays + 1.3 + 0.2) << outcome_of(result);
    if (HasFailure()) break;
  }
  EXPECT_GT(disturbed, 180U);
  EXPECT_GT(bad_samples, 3000U);
}

TEST(FrameFaultRun, IsolatesTheTrueFaultAfterAnyTimelineOfFrameFaults) {
  const std::uint64_t seed = test_seed(900);
  SCOPED_TRACE(seed_message(seed));
  BenchInputs inputs = load_bench_inputs(kBusFaults / "dropped.toml");
  inputs.scenario.expectations.clear();
  for (std::uint64_t round = 0; round < 50; ++round) {
    std::vector<Injection> injections = RandomTimeline(seed + round, inputs.schedule.targets())();
    SCOPED_TRACE(fmt::format("round {}\n{}", round, text_of(injections)));
    injections.push_back({.target = "u3", .kind = kBias, .value = 2.0, .at_s = 2.5});
    inputs.schedule =
        FaultSchedule(inputs.schedule.targets(), injections, static_cast<std::int64_t>(round));
    const BenchResult result = run(inputs);
    EXPECT_EQ(verdict_text(result.history.verdicts().back()), "isolated u3") << outcome_of(result);
    for (const VerdictEntry& entry : result.history.verdicts()) {
      if (entry.verdict != Verdict::kIsolated) continue;
      EXPECT_EQ(verdict_text(entry), "isolated u3");
    }
    if (HasFailure()) break;
  }
}

}  // namespace
}  // namespace faultline

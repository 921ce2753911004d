// Live and replayed decisions agree whatever the bus does to the order of frames: what is decided
// is a function of the frames in the order in which the diagnosis received them.
#include <algorithm>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "tests/support/random_seed.h"
#include "tests/tools/bench/changing_bus.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/replay/log_replay.h"

namespace faultline {
namespace {

const std::filesystem::path kExample =
    std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015" / "demo.toml";

/// Frames swap places within a window, come late by up to `most_late` frames, are lost or doubled;
/// in bouts, with quiet stretches between them.
class UnrulyLine {
 public:
  struct Rates {
    double swapped = 0.0, late = 0.0, lost = 0.0, doubled = 0.0;
    std::size_t most_late = 40;  ///< frames: 8 cycles
  };
  UnrulyLine(std::uint64_t seed, Rates rates) : draw_(seed), rates_(rates) {}

  void operator()(const CanFrame& frame, std::deque<CanFrame>& out) {
    ++count_;
    release(out);
    const bool is_quiet = count_ % kBout >= kBout / 4;
    if (is_quiet) return out.push_back(frame);
    if (is_drawn(rates_.lost)) return;
    if (is_drawn(rates_.doubled)) out.push_back(frame);
    if (is_drawn(rates_.late)) {
      held_.push_back({count_ + 1 + draw_() % rates_.most_late, frame});
      return;
    }
    if (!out.empty() && is_drawn(rates_.swapped)) {
      out.insert(out.end() - static_cast<std::ptrdiff_t>(
                                 1 + draw_() % std::min<std::size_t>(out.size(), 5)),
                 frame);
      return;
    }
    out.push_back(frame);
  }

 private:
  struct Held {
    std::uint64_t until = 0;
    CanFrame frame;
  };
  static constexpr std::uint64_t kBout = 1000;

  bool is_drawn(double rate) { return std::uniform_real_distribution<>(0.0, 1.0)(draw_) < rate; }
  void release(std::deque<CanFrame>& out) {
    for (auto held = held_.begin(); held != held_.end();) {
      if (held->until > count_) {
        ++held;
        continue;
      }
      out.push_back(held->frame);
      held = held_.erase(held);
    }
  }

  std::mt19937_64 draw_;
  Rates rates_;
  std::uint64_t count_ = 0;
  std::deque<Held> held_;
};

struct Case {
  const char* name;
  UnrulyLine::Rates rates;
  bool must_spoil;  ///< some samples are bad for sure
};

class BusOrder : public testing::TestWithParam<Case> {};

TEST_P(BusOrder, LiveAndReplayedDecisionsAgreeToTheBit) {
  const TemporaryFolder folder;
  const std::filesystem::path log = folder.path() / "run.lcm";
  const BenchInputs inputs = load_bench_inputs(kExample);
  const std::uint64_t seed = test_seed(500);
  for (std::uint64_t round = 0; round < 5; ++round) {
    SCOPED_TRACE(seed_message(seed) + ", round " + std::to_string(round));
    const BenchResult live = run_through(inputs, UnrulyLine(seed + round, GetParam().rates), &log);
    EXPECT_TRUE(live.counters.bad_samples > 0 || !GetParam().must_spoil);
    const ReplayResult result = replay({.logs = {log.string()}});
    ASSERT_EQ(result.runs.size(), 1U);
    const RunReplay& run = result.runs[0];
    EXPECT_EQ(run.missing_frames, 0U);
    EXPECT_EQ(run.answers[0].bad_samples, live.counters.bad_samples);
    ASSERT_TRUE(run.verification);
    EXPECT_TRUE(run.verification->is_verified());
    const ResultComparison::Counts counts =
        run.verification->comparison.counts(ResultChannel::kResidual);
    EXPECT_EQ(counts.identical, live.counters.samples);
    EXPECT_EQ(counts.unrecorded, 0U);
    ASSERT_EQ(run.answers[0].verdicts.size(), live.history.verdicts().size());
    for (std::size_t i = 0; i < live.history.verdicts().size(); ++i) {
      EXPECT_EQ(verdict_text(run.answers[0].verdicts[i]), verdict_text(live.history.verdicts()[i]));
      EXPECT_EQ(run.answers[0].verdicts[i].t_s, live.history.verdicts()[i].t_s);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Lines, BusOrder,
    testing::Values(
        Case{"Reordered", {.swapped = 0.3}, false}, Case{"Late", {.late = 0.02}, true},
        Case{"Lost", {.lost = 0.02}, true}, Case{"Doubled", {.doubled = 0.02}, true},
        Case{"AllOfIt", {.swapped = 0.2, .late = 0.05, .lost = 0.05, .doubled = 0.05}, true}),
    [](const testing::TestParamInfo<Case>& line) { return line.param.name; });

/// In real time, where the threads' timing decides the order, nobody can say it beforehand.
TEST(BusOrderInRealTime, LiveAndReplayedDecisionsAgreeToTheBit) {
  const TemporaryFolder folder;
  BenchInputs inputs = load_bench_inputs(kExample);
  inputs.scenario.duration_s = 2.0;
  BenchOptions options;
  options.bus = "loop";
  options.is_realtime = true;
  options.log = folder.path() / "run.lcm";
  BenchRun run(inputs, options);
  run.buses.diagnosis = std::make_unique<ChangingBus>(
      std::move(run.buses.diagnosis),
      UnrulyLine(test_seed(600), {.swapped = 0.2, .late = 0.05, .lost = 0.05, .doubled = 0.05}));
  run_realtime(run);
  const BenchResult live = run.finish(run.utime_of(inputs.scenario.duration_s));
  ASSERT_EQ(live.counters.records_dropped, 0U);
  const ReplayResult result = replay({.logs = {options.log->string()}});
  ASSERT_EQ(result.runs.size(), 1U);
  ASSERT_TRUE(result.runs[0].verification);
  EXPECT_TRUE(result.runs[0].verification->is_verified());
  EXPECT_EQ(result.runs[0].verification->comparison.counts(ResultChannel::kResidual).identical,
            live.counters.samples);
}

}  // namespace
}  // namespace faultline

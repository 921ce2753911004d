#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <faultline/can_t.hpp>
#include <faultline/event_t.hpp>
#include <faultline/stats_t.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"
#include "tools/bench/bench_run.h"
#include "tools/bench/latency_table.h"
#include "tools/lcm/channels.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

constexpr std::uint64_t kPlantFrames = 3;  // SYNC and two messages of sensors

/// Blocks once, in the middle of the run: the thread that sends the cycles misses deadlines.
class StallingBus final : public CanBus {
 public:
  StallingBus(std::unique_ptr<CanBus> bus, int before, std::chrono::milliseconds stall)
      : bus_(std::move(bus)), before_(before), stall_(stall) {}
  bool send(const CanFrame& frame) noexcept override { return bus_->send(frame); }
  std::size_t send_batch(std::span<const CanFrame> frames) noexcept override {
    if (before_-- == 0) std::this_thread::sleep_for(stall_);
    return bus_->send_batch(frames);
  }
  ReceiveResult receive(std::span<CanFrame> out,
                        std::chrono::nanoseconds timeout) noexcept override {
    return bus_->receive(out, timeout);
  }
  void set_filters(std::span<const IdFilter> filters) override { bus_->set_filters(filters); }
  [[nodiscard]] int readiness_fd() const noexcept override { return bus_->readiness_fd(); }
  [[nodiscard]] BusCounters counters() const noexcept override { return bus_->counters(); }
  [[nodiscard]] std::string name() const override { return bus_->name(); }

 private:
  std::unique_ptr<CanBus> bus_;
  int before_;
  std::chrono::milliseconds stall_;
};

BenchInputs short_demo(double duration_s) {
  BenchInputs inputs =
      load_bench_inputs(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015" / "demo.toml");
  inputs.scenario.duration_s = duration_s;
  inputs.scenario.expectations.clear();
  inputs.scenario.injections.clear();
  inputs.schedule = FaultSchedule(inputs.plant, {});
  return inputs;
}

/// What this thread did to the heap since it first asked.
std::uint64_t guarded_heap_calls() noexcept {
  thread_local const AllocationGuard guard;
  return guard.heap_calls();
}

class RealtimeRun : public testing::Test {
 protected:
  RealtimeRun() {
    options_.bus = "loop";
    options_.is_realtime = true;
    options_.log = folder_.path() / "run.lcm";
  }
  /// A second of 100 Hz whose plant stalls in cycle 40.
  BenchResult run_stalled(OverrunPolicy policy, std::chrono::milliseconds stall = 95ms) {
    options_.overrun = policy;
    BenchRun run(inputs_, options_);
    run.buses.plant = std::make_unique<StallingBus>(std::move(run.buses.plant), 40, stall);
    run_realtime(run);
    return run.finish(run.utime_of(inputs_.scenario.duration_s));
  }
  template <class Message>
  std::vector<Message> logged(const char* channel) {
    return logged_messages<Message>(*options_.log, channel);
  }

  const TemporaryFolder folder_;
  BenchInputs inputs_ = short_demo(1.0);
  BenchOptions options_;
};

const LatencyHistogram& of(const BenchResult& result, const std::string& stage) {
  for (const StageLatency& found : result.latencies) {
    if (found.stage == stage) return found.histogram;
  }
  throw std::out_of_range(stage);
}

TEST_F(RealtimeRun, CatchesUpWithCyclesThatAStallMadeLate) {
  const BenchResult result = run_stalled(OverrunPolicy::kCatchUp);
  EXPECT_EQ(result.counters.cycles, 101U);
  EXPECT_GE(result.counters.overruns, 8U);
  EXPECT_EQ(result.counters.skipped_cycles, 0U);
  EXPECT_EQ(result.counters.frames_received, result.counters.frames_sent);
  EXPECT_GE(result.counters.frames_sent, kPlantFrames * 101U);
  EXPECT_EQ(result.counters.samples, 101U);
  // Every cycle was sent and has a deadline of its own: nothing to fill in.
  EXPECT_EQ(of(result, "due->sent").count(), 101U);
  EXPECT_EQ(of(result, "due->sent").corrected(), 0U);
  EXPECT_GE(of(result, "due->sent").max(), 95ms);
  EXPECT_FALSE(result.stop_reason);
}

TEST_F(RealtimeRun, SkipsCyclesAsAUnitThatMissedItsTurn) {
  const BenchResult result = run_stalled(OverrunPolicy::kSkip);
  const std::uint64_t skipped = result.counters.skipped_cycles;
  EXPECT_EQ(result.counters.cycles, 101U);  // the plant went on in all of them
  EXPECT_GE(skipped, 8U);
  EXPECT_EQ(skipped, result.counters.overruns);
  const LatencyHistogram& sent = of(result, "due->sent");
  EXPECT_LE(sent.corrected(), skipped);
  EXPECT_GE(sent.corrected(), 8U);
  EXPECT_EQ(sent.count(), 101U - skipped + sent.corrected());
  EXPECT_GE(sent.max(), 95ms);
  EXPECT_GE(result.counters.bad_samples, 8U);  // the diagnosis saw the gap
  EXPECT_EQ(result.counters.frames_received, result.counters.frames_sent);
  std::uint64_t plant_frames = 0;
  for (const can_t& can : logged<can_t>(kCanChannel)) {
    for (const can_frame_t& frame : can.frames) plant_frames += frame.id < 288 ? 1U : 0U;
  }
  EXPECT_EQ(plant_frames, kPlantFrames * (101U - skipped));
  EXPECT_EQ(logged<stats_t>(kStatsChannel).back().skipped_cycles,
            static_cast<std::int64_t>(skipped));
}

TEST_F(RealtimeRun, StopsAtTheFirstOverrunAndSaysWhereAndHowLate) {
  const BenchResult result = run_stalled(OverrunPolicy::kStop);
  ASSERT_TRUE(result.stop_reason);
  EXPECT_EQ(result.stop_reason->kind, StopReason::Kind::kOverrun);
  EXPECT_THAT(result.stop_reason->text,
              testing::ContainsRegex("cycle [0-9]+ began [0-9.]+ ms late"));
  EXPECT_EQ(result.counters.overruns, 1U);
  EXPECT_LT(result.counters.cycles, 101U);
  EXPECT_EQ(logged<event_t>(kEventChannel).back().text, result.stop_reason->text);
  EXPECT_EQ(logged<stats_t>(kStatsChannel).back().is_final, 1);
}

TEST_F(RealtimeRun, TellsOfABusThatFellSilentAndOfItsReturn) {
  static_cast<void>(run_stalled(OverrunPolicy::kCatchUp, 900ms));
  std::vector<std::string> told;
  for (const event_t& event : logged<event_t>(kEventChannel)) {
    if (event.source == "watchdog") told.push_back(event.text);
  }
  EXPECT_THAT(
      told, testing::ElementsAre(HasSubstr("bus silent: no frame for "), HasSubstr("bus is back")));
}

TEST_F(RealtimeRun, TellsTheLatencyOfEachStageInStats) {
  const BenchResult result = run_bench(inputs_, options_);
  std::vector<std::string> names;
  for (const StageLatency& stage : result.latencies) {
    names.push_back(stage.stage);
    EXPECT_GT(stage.histogram.count(), 0U) << stage.stage;
    EXPECT_GE(stage.cycles_per_value, 1U);
  }
  EXPECT_THAT(names, testing::ElementsAre("due->sent", "stamp->read", "read->decoded",
                                          "decoded->stepped", "stepped->decided", "decided->queued",
                                          "queued->published", "total", "end to end"));
  EXPECT_LE(of(result, "stamp->read").min(), of(result, "total").min());
  EXPECT_LE(of(result, "total").min(), of(result, "end to end").min());
  const stats_t stats = logged<stats_t>(kStatsChannel).back();
  ASSERT_EQ(stats.latency.size(), names.size());
  std::vector<StageLatency> read_back;
  for (const latency_histogram_t& latency : stats.latency) {
    read_back.push_back(to_stage_latency(latency));
  }
  EXPECT_EQ(latency_table(read_back), latency_table(result.latencies));
  EXPECT_THAT(latency_table(read_back), HasSubstr("end to end"));
}

TEST_F(RealtimeRun, HasNoLatenciesInLockStep) {
  options_.is_realtime = false;
  const BenchResult result = run_bench(inputs_, options_);
  EXPECT_TRUE(result.latencies.empty());
  EXPECT_EQ(latency_table(result.latencies), "");
  EXPECT_EQ(logged<stats_t>(kStatsChannel).back().stage_count, 0);
}

TEST_F(RealtimeRun, DoesNotAllocateInTheDiagnosisThreadAfterWarmUp) {
  options_.thread_allocations = &guarded_heap_calls;
  const BenchResult result = run_bench(inputs_, options_);
  ASSERT_TRUE(result.counters.allocations);
  EXPECT_EQ(*result.counters.allocations, 0U);
  EXPECT_TRUE(result.counters.page_faults);
  EXPECT_EQ(logged<stats_t>(kStatsChannel).back().allocations, 0);
}

std::uint64_t one_more_each_time() noexcept {
  static std::atomic<std::uint64_t> calls{0};
  return ++calls;
}

TEST_F(RealtimeRun, TellsOfAllocationsWhereThereAreSome) {
  options_.thread_allocations = &one_more_each_time;
  const BenchResult result = run_bench(inputs_, options_);
  EXPECT_GT(result.counters.allocations.value(), 40U);
}

TEST_F(RealtimeRun, AccountsForFramesThatTheLogHadNoRoomFor) {
  options_.frame_slots = 16;
  bool has_slept = false;
  options_.on_progress = [&has_slept](double t_s, double, const std::string&) {
    if (t_s < 0.2 || has_slept) return;
    has_slept = true;
    std::this_thread::sleep_for(300ms);  // 150 frames
  };
  const BenchResult result = run_bench(inputs_, options_);
  EXPECT_TRUE(has_slept);
  EXPECT_GT(result.counters.frames_unlogged, 0U);
  EXPECT_EQ(result.counters.frames_received, result.counters.frames_sent);
  std::int64_t next = 0;
  std::int64_t missing = 0;
  std::uint64_t logged_frames = 0;
  for (const can_t& can : logged<can_t>(kCanChannel)) {
    missing += can.first_frame - next;
    next = can.first_frame + can.frame_count;
    logged_frames += can.frames.size();
  }
  missing += static_cast<std::int64_t>(result.counters.frames_received) - next;
  EXPECT_EQ(static_cast<std::uint64_t>(missing), result.counters.frames_unlogged);
  EXPECT_EQ(logged_frames + result.counters.frames_unlogged, result.counters.frames_received);
  EXPECT_EQ(logged<stats_t>(kStatsChannel).back().frames_unlogged, missing);
}

TEST_F(RealtimeRun, HasAProbeReadBesideTheDiagnosis) {
  options_.has_probe = true;
  const BenchResult result = run_bench(inputs_, options_);
  EXPECT_EQ(result.latencies.back().stage, "probe: stamp->read");
  // One frame of each cycle that the controller answered.
  EXPECT_GE(of(result, "probe: stamp->read").count(), 90U);
  EXPECT_LE(of(result, "probe: stamp->read").count(), 101U);
}

TEST_F(RealtimeRun, WarnsOnceOfWhatItMayNotHaveAndGoesOn) {
  options_.cpu = 1023;
  std::vector<std::string> warnings;
  options_.on_warning = [&warnings](const std::string& text) { warnings.push_back(text); };
  const BenchResult result = run_bench(inputs_, options_);
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_THAT(warnings[0], HasSubstr("the diagnosis thread is not bound to CPU 1023"));
  EXPECT_THAT(warnings[0], HasSubstr("type: taskset"));
  const auto events = logged<event_t>(kEventChannel);
  EXPECT_EQ(std::count_if(events.begin(), events.end(),
                          [&](const event_t& event) { return event.text == warnings[0]; }),
            1);
  EXPECT_EQ(result.counters.cycles, 101U);
}

}  // namespace
}  // namespace faultline

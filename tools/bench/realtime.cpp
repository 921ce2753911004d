#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <latch>
#include <mutex>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <fmt/format.h>

#include "tools/bench/bench_run.h"
#include "tools/bench/bus_silence.h"
#include "tools/bench/plant_loop.h"
#include "tools/bench/realtime_sink.h"
#include "tools/bench/realtime_thread.h"
#include "tools/bench/slot_queue.h"
#include "tools/bench/stage_latencies.h"
#include "tools/lcm/frame_message.h"

namespace faultline {
namespace {

using std::chrono::steady_clock;
using Nanoseconds = std::chrono::nanoseconds;

constexpr std::size_t kBatch = 64;
/// Longest wait on a bus before a thread looks whether it shall stop.
constexpr Nanoseconds kIdleWait = PlantLoop::kIdleWait;
/// After the last cycle the answers and the last frames are waited for this long.
constexpr Nanoseconds kGrace = std::chrono::milliseconds(100);
/// The publisher looks into its queues this often.
constexpr Nanoseconds kPublishPeriod = std::chrono::milliseconds(2);
/// Clocks slewed by the kernel's most, 500 ppm, part by 10 µs meanwhile.
constexpr Nanoseconds kCompareClocksPeriod = std::chrono::milliseconds(20);
/// By then every path of a good cycle has been taken: what the linker binds at the first call is
/// bound.
constexpr std::uint64_t kWarmUpSamples = 50;

/// No cycle has begun yet: their counter never comes to that (check_duration).
constexpr std::uint32_t kNoCycle = kNoCommand;

struct ProbeRead {
  Timestamp stamp;
  steady_clock::time_point read;
};

/// Identifier of the message that closes a sample in the ordinary course: the last command, or the
/// last measurement where nobody answers.
std::uint32_t closing_id(const SignalMap& map) {
  if (!map.command_messages.empty()) return map.command_messages.back().id;
  return map.sensor_messages.empty() ? 0 : map.sensor_messages.back().id;
}

class Realtime final : private PlantLoopHost {
 public:
  explicit Realtime(BenchRun& run)
      : run_(run),
        period_(std::chrono::duration_cast<Nanoseconds>(
            std::chrono::duration<double>(run.inputs.bank.sample_time_s))),
        cycles_per_value_(cycles_per_timed_sample(steady_clock_cost(), period_)),
        sink_(run.inputs.bank, run.options.frame_slots, run.options.record_slots,
              cycles_per_value_),
        truths_(run.options.record_slots, PlantCycle{.x = run.inputs.x_initial}),
        probe_reads_(run.options.record_slots, ProbeRead{}),
        plant_loop_(run.plant, run.plant_faults, *run.buses.plant, run.inputs.bank.sample_time_s,
                    run.options.overrun, run.plant_faults.most_frames()),
        latencies_(period_, cycles_per_value_, run.buses.probe != nullptr),
        silence_(period_),
        closing_id_(closing_id(run.inputs.map)),
        threads_ready_(run.buses.probe ? 4 : 3) {
    run.controller_faults.set_output(*run.buses.controller);
  }

  void run() {
    std::optional<RealtimeProcess> process;
    if (run_.options.priority > 0) process.emplace();
    std::vector<std::thread> threads;
    threads.emplace_back([this] { run_diagnosis(); });
    threads.emplace_back([this] { run_plant(); });
    threads.emplace_back([this] { run_controller(); });
    if (run_.buses.probe) threads.emplace_back([this] { run_probe(); });
    threads_ready_.wait();
    try {
      if (process) warn_of(process->problems());
      warn_of_threads();
      start_ = steady_clock::now() + kIdleWait;
      started_.count_down();
      publish_until_done();
    } catch (...) {
      // Join before unwinding: the threads use what is about to be destroyed.
      must_stop_ = true;
      if (!started_.try_wait()) started_.count_down();
      for (std::thread& thread : threads) thread.join();
      throw;
    }
    for (std::thread& thread : threads) thread.join();
    drain_queues();
    latencies_.finish();
    run_.latencies = latencies_.stages();
    run_.set_pace_counters(counters_now());
    if (sink_.frames.dropped() > 0) {
      run_.publisher.publish_event(
          -1, "warning", "publisher",
          fmt::format("{} received frames are missing in the log: its queue was full",
                      sink_.frames.dropped()),
          last_utime_);
    }
    if (failure_) run_.stop(*failure_);
  }

 private:
  using Problems = std::vector<RealtimeProblem>;

  /// A thread's first act. The diagnosis goes before the plant, the plant before the controller:
  /// the latency of the diagnosis is what is measured, and it needs microseconds of a cycle; the
  /// unit leads the cycle, and the controller answers it.
  void set_up_thread(const char* name, int below_diagnosis, std::optional<int> cpu,
                     Problems& problems) {
    const int priority =
        run_.options.priority > 0 ? std::max(run_.options.priority - below_diagnosis, 1) : 0;
    problems = make_thread_realtime(name, priority, cpu);
    prefault_stack();
    threads_ready_.count_down();
    started_.wait();
  }

  // --- plant thread: leads the cycle at absolute deadlines.
  void run_plant() {
    set_up_thread("plant", 1, std::nullopt, plant_problems_);
    if (auto reason = plant_loop_.run(start_, run_.cycle_count(), *this)) {
      // The cycle that ended the run was not lived.
      if (reason->kind == StopReason::Kind::kOverrun) ++overruns_;
      fail(std::move(*reason));
    }
    plant_loop_.take_commands_until(steady_clock::now() + kGrace, *this);
    is_over_ = true;
  }

  bool must_stop() noexcept override { return must_stop_; }

  void on_begin(std::uint32_t k) noexcept override { cycle_.store(k, std::memory_order_release); }

  void on_cycle(const PlantCycle& cycle) noexcept override {
    if (cycle.is_overrun) ++overruns_;
    if (!cycle.is_sent) ++skipped_cycles_;
    truths_.push(cycle);
  }

  void on_received(const ReceiveResult& received, std::span<const CanFrame> /*frames*/) override {
    watch(received, *run_.buses.plant);
  }

  // --- controller thread: answers measurements.
  void run_controller() {
    set_up_thread("controller", 2, std::nullopt, controller_problems_);
    // Its faults follow the cycles even while it hears nothing.
    const Nanoseconds wait = std::min<Nanoseconds>(period_, kIdleWait);
    std::uint32_t cycle = kNoCycle;
    while (!is_over_ && !must_stop_) {
      const ReceiveResult received = run_.buses.controller->receive(controller_batch_, wait);
      const std::uint32_t now = cycle_.load(std::memory_order_acquire);
      if (now != cycle) run_.controller_faults.begin_cycle(now);
      cycle = now;
      for (std::size_t i = 0; i < received.count && run_.controller_faults.hears(); ++i) {
        run_.controller.on_frame(controller_batch_[i], run_.controller_faults);
      }
      watch(received, *run_.buses.controller);
    }
  }

  // --- diagnosis thread: waits on its bus, reads a batch, diagnoses, queues.
  void run_diagnosis() {
    set_up_thread("diagnosis", 0, run_.options.cpu, diagnosis_problems_);
    const auto heap_calls = run_.options.thread_allocations;
    bool is_warm = false;
    std::uint64_t heap_calls_before = 0;
    std::uint64_t page_faults_before = 0;
    for (;;) {
      const bool may_end = is_over_ || must_stop_;
      const ReceiveResult received = run_.buses.diagnosis->receive(diagnosis_batch_, kIdleWait);
      if (received.count > 0) {
        sink_.begin_batch(steady_clock::now());
        for (std::size_t i = 0; i < received.count; ++i) {
          run_.diagnosis.on_frame(diagnosis_batch_[i], sink_);
        }
      }
      watch(received, *run_.buses.diagnosis);
      if (received.count == 0 && may_end) break;
      if (!is_warm && sink_.record_count() >= kWarmUpSamples) {
        is_warm = true;
        page_faults_before = thread_page_faults();
        if (heap_calls != nullptr) heap_calls_before = heap_calls();
      } else if (is_warm && heap_calls != nullptr) {
        allocations_.store(static_cast<std::int64_t>(heap_calls() - heap_calls_before),
                           std::memory_order_relaxed);
      }
    }
    if (is_warm) {
      page_faults_ = static_cast<std::int64_t>(thread_page_faults() - page_faults_before);
    }
    sink_.begin_end();
    run_.diagnosis.finish(sink_);
    is_diagnosis_over_ = true;
  }

  // --- probe thread: what a bare reader of the same bus sees, to compare.
  void run_probe() {
    set_up_thread("probe", 0, std::nullopt, probe_problems_);
    while (!is_diagnosis_over_) {
      const ReceiveResult received = run_.buses.probe->receive(probe_batch_, kIdleWait);
      if (received.count == 0) continue;
      const auto read = steady_clock::now();
      for (std::size_t i = 0; i < received.count; ++i) {
        if (probe_batch_[i].id == closing_id_) probe_reads_.push({probe_batch_[i].stamp, read});
      }
    }
  }

  /// A bus that is down comes back, and the cycles go on meanwhile: BenchRun tells of it.
  void watch(const ReceiveResult& received, const CanBus& bus) {
    if (received.status != ReceiveStatus::kError) return;
    fail({StopReason::Kind::kBus, fmt::format("{} failed: {}", bus.name(),
                                              std::generic_category().message(bus.last_error()))});
  }

  void fail(StopReason reason) {
    const std::lock_guard lock(failure_mutex_);
    if (!failure_) failure_ = std::move(reason);
    must_stop_ = true;
  }

  // --- calling thread: publishes.

  /// What one thread may not have the others may not have either: told once.
  void warn_of_threads() {
    for (const Problems* problems :
         {&diagnosis_problems_, &plant_problems_, &controller_problems_, &probe_problems_}) {
      if (problems->empty()) continue;
      warn_of(*problems);
      return;
    }
  }

  void warn_of(const Problems& problems) {
    for (const RealtimeProblem& problem : problems) {
      const std::string text = to_text(problem);
      run_.publisher.publish_event(-1, problem.remedy.empty() ? "info" : "warning", "bench", text,
                                   run_.start_utime());
      if (run_.options.on_warning) run_.options.on_warning(text);
    }
  }

  void publish_until_done() {
    boost::asio::io_context context(1);
    boost::asio::steady_timer timer(context);
    auto next_comparison = steady_clock::now();
    for (bool is_done = false; !is_done;) {
      timer.expires_after(kPublishPeriod);
      timer.async_wait([](const boost::system::error_code&) {});
      context.restart();
      context.run();
      const auto now = steady_clock::now();
      if (now >= next_comparison) {
        latencies_.compare_clocks();
        next_comparison = now + kCompareClocksPeriod;
      }
      is_done = is_diagnosis_over_;
      drain_queues();
      if (!is_over_ && !must_stop_) watch_silence(now);
      if (run_.attend(run_.time_of(last_cycle_), last_utime_)) must_stop_ = true;
      if (!is_over_) {
        run_.take_injections(plant_loop_.free_cycle(start_, now),
                             to_utime(std::chrono::system_clock::now()));
      }
    }
  }

  void watch_silence(steady_clock::time_point now) {
    const auto text = silence_.look(run_.buses.diagnosis->counters().received, now);
    if (!text) return;
    const std::int64_t utime = to_utime(std::chrono::system_clock::now());
    run_.publisher.publish_event(last_cycle_, "warning", "watchdog", *text, utime);
  }

  void drain_queues() {
    run_.set_pace_counters(counters_now());
    while (const PlantCycle* truth = truths_.front()) {
      if (truth->is_sent) {
        latencies_.on_sent(truth->since_due);
      } else {
        latencies_.on_skipped();
      }
      if (run_.is_stats_due(run_.utime_of(run_.time_of(truth->truth.cycle)))) {
        run_.latencies = latencies_.stages();
      }
      run_.on_truth(truth->truth, truth->x, run_.utime_of(run_.time_of(truth->truth.cycle)));
      truths_.pop();
    }
    while (const NumberedFrame* received = sink_.frames.front()) {
      last_utime_ = to_utime(received->frame.stamp);
      run_.on_frame(received->frame, received->number, last_utime_);
      sink_.frames.pop();
    }
    run_.publisher.flush_frames();
    while (const QueuedRecord* queued = sink_.records.front()) {
      last_cycle_ = queued->record.cycle;
      run_.on_record(queued->record, to_utime(queued->record.stamp));
      const bool is_timed = queued->times.has_stages;
      latencies_.on_record(queued->record, queued->times,
                           is_timed ? steady_clock::now() : steady_clock::time_point{});
      sink_.records.pop();
    }
    while (const ProbeRead* probe = probe_reads_.front()) {
      latencies_.on_probe(probe->stamp, probe->read);
      probe_reads_.pop();
    }
  }

  [[nodiscard]] PaceCounters counters_now() const {
    PaceCounters counters{.overruns = overruns_,
                          .skipped_cycles = skipped_cycles_,
                          .records_dropped = sink_.records.dropped(),
                          .frames_unlogged = sink_.frames.dropped()};
    const std::int64_t allocations = allocations_.load(std::memory_order_relaxed);
    if (allocations >= 0) counters.allocations = static_cast<std::uint64_t>(allocations);
    if (page_faults_ >= 0) counters.page_faults = static_cast<std::uint64_t>(page_faults_);
    return counters;
  }

  BenchRun& run_;
  Nanoseconds period_;
  std::uint32_t cycles_per_value_;
  RealtimeSink sink_;
  SlotQueue<PlantCycle> truths_;
  SlotQueue<ProbeRead> probe_reads_;
  PlantLoop plant_loop_;
  StageLatencies latencies_;
  BusSilence silence_;
  std::uint32_t closing_id_;
  std::latch threads_ready_;
  std::latch started_{1};
  steady_clock::time_point start_;  // set before started_
  // Each written by its thread before threads_ready_.
  Problems diagnosis_problems_, plant_problems_, controller_problems_, probe_problems_;
  std::array<CanFrame, kBatch> controller_batch_{}, diagnosis_batch_{}, probe_batch_{};
  std::atomic<std::uint32_t> cycle_{kNoCycle};  ///< of the plant
  std::atomic<bool> must_stop_{false}, is_over_{false}, is_diagnosis_over_{false};
  std::atomic<std::uint64_t> overruns_{0}, skipped_cycles_{0};
  std::atomic<std::int64_t> allocations_{-1}, page_faults_{-1};  ///< -1: not counted
  std::mutex failure_mutex_;
  std::optional<StopReason> failure_;
  std::uint32_t last_cycle_ = 0;
  std::int64_t last_utime_ = 0;
};

}  // namespace

void run_realtime(BenchRun& run) { Realtime(run).run(); }

}  // namespace faultline

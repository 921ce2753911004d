#include "tools/bench/plant_process.h"

#include <atomic>
#include <chrono>
#include <system_error>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "tools/bench/endpoints.h"
#include "tools/bench/live_injection.h"
#include "tools/bench/message_silence.h"
#include "tools/bench/plant_loop.h"
#include "tools/bench/slot_queue.h"
#include "tools/bench/stop_signal.h"

namespace faultline {
namespace {

using std::chrono::steady_clock;
using Nanoseconds = std::chrono::nanoseconds;

constexpr auto kPublishPeriod = std::chrono::milliseconds(2);
constexpr auto kFlushPeriod = std::chrono::milliseconds(50);
constexpr auto kRepeatPeriod = std::chrono::seconds(5);
constexpr std::size_t kCycleSlots = 1024;

std::int64_t utime_now() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

class PlantProcess final : private PlantLoopHost {
 public:
  PlantProcess(const BenchInputs& inputs, const PlantProcessOptions& options)
      : inputs_(inputs),
        options_(options),
        bus_(open_node(options.bus, inputs.map, BenchNode::kPlant)),
        schedule_(inputs.schedule),
        plant_(inputs.make_plant(), inputs.map, schedule_, inputs.bank.sample_time_s,
               inputs.x_initial, inputs.perturbations),
        faults_(inputs.map, schedule_, BenchNode::kPlant, inputs.bank.sample_time_s),
        loop_(plant_, faults_, *bus_, inputs.bank.sample_time_s, options.overrun,
              faults_.most_frames()),
        silence_(inputs.map, messages_of_controller(inputs.map),
                 std::chrono::duration_cast<Nanoseconds>(
                     std::chrono::duration<double>(inputs.bank.sample_time_s))),
        cycles_(kCycleSlots, PlantCycle{.x = inputs.x_initial}) {
    auto live = options.lcm_url ? open_live(*options.lcm_url) : nullptr;
    if (options.lcm_url && can_listen_to(*options.lcm_url)) {
      injection_.emplace(*options.lcm_url, schedule_, inputs.bank.sample_time_s, BenchNode::kPlant);
    }
    // The log comes last: nothing else may fail once an old log has been replaced.
    auto log = options.log ? open_log(*options.log) : nullptr;
    publisher_.emplace(inputs, std::vector<std::vector<std::size_t>>{}, std::move(log),
                       std::move(live));
    cycles_per_second_ = std::max(1L, std::lround(1.0 / inputs.bank.sample_time_s));
  }

  PlantProcessResult run() {
    start_utime_ = utime_now();
    publisher_->publish_parts(start_utime_);
    tell("info", "plant", fmt::format("plant of {} on {}", inputs_.scenario.name, bus_->name()));
    start_ = steady_clock::now() + PlantLoop::kIdleWait;
    std::thread thread([this] {
      result_.stop_reason = loop_.run(start_, options_.cycle_count, *this);
      is_over_ = true;
    });
    try {
      publish_until_over();
    } catch (...) {
      must_stop_ = true;
      thread.join();
      throw;
    }
    thread.join();
    drain();
    finish();
    return std::move(result_);
  }

 private:
  // --- plant thread

  bool must_stop() noexcept override { return must_stop_; }
  void on_begin(std::uint32_t /*k*/) noexcept override {}
  void on_cycle(const PlantCycle& cycle) noexcept override { cycles_.push(cycle); }
  void on_received(const ReceiveResult& received, std::span<const CanFrame> frames) override {
    for (const CanFrame& frame : frames) silence_.count(frame);
    if (received.status != ReceiveStatus::kError) return;
    has_bus_failed_ = true;
    must_stop_ = true;
  }

  // --- calling thread

  void publish_until_over() {
    auto next_flush = steady_clock::now(), next_repeat = next_flush + kRepeatPeriod;
    while (!is_over_) {
      std::this_thread::sleep_for(kPublishPeriod);
      drain();
      const auto now = steady_clock::now();
      watch(now);
      if (injection_) {
        const std::uint32_t cycle = loop_.free_cycle(start_, now);
        injection_->attend(cycle, [&](const char* severity, const std::string& text) {
          tell(severity, "inject", text, cycle);
        });
      }
      if (result_.signal == 0) result_.signal = stop_signal_.poll();
      if (result_.signal != 0) must_stop_ = true;
      if (now >= next_flush) {
        publisher_->flush();
        next_flush = now + kFlushPeriod;
      }
      if (now >= next_repeat) {
        publisher_->repeat_parts();
        next_repeat = now + kRepeatPeriod;
      }
    }
  }

  void drain() {
    while (const PlantCycle* cycle = cycles_.front()) {
      follow(*cycle);
      cycles_.pop();
    }
  }

  void follow(const PlantCycle& cycle) {
    const std::uint32_t k = cycle.truth.cycle;
    const double t_s = k * inputs_.bank.sample_time_s;
    const std::int64_t utime = start_utime_ + std::llround(t_s * 1e6);
    cycle_ = k;
    RunCounters& counters = result_.counters;
    ++counters.cycles;
    if (cycle.truth.is_late) ++counters.late_cycles;
    if (cycle.is_overrun) ++counters.overruns;
    if (!cycle.is_sent) ++counters.skipped_cycles;
    publisher_->publish_truth(cycle.truth, schedule_, cycle.x, utime);
    follow_timeline(k, t_s);
    if (!is_answered_ && cycle.truth.command_cycle != kNoCommand) {
      is_answered_ = true;
      tell("info", "plant", fmt::format("commands come: cycle {} is the first that acts on one", k),
           k);
    }
    if (k % static_cast<std::uint32_t>(cycles_per_second_) == 0) {
      publisher_->publish_stats(counters_now(), {}, k, utime, false);
    }
  }

  /// A line when an entry first acts, and one when it is over for good.
  void follow_timeline(std::uint32_t k, double t_s) {
    told_.resize(schedule_.size());
    for (std::size_t i = 0; i < told_.size(); ++i) {
      const Injection& injection = schedule_.injection(i);
      const bool is_acting = schedule_.activity(i, t_s) > 0.0;
      if (is_acting && !told_[i].has_begun) {
        told_[i].has_begun = true;
        result_.faults.push_back(
            {injection.target, std::string(injection_kind_name(injection.kind)), k});
        tell("info", "plant",
             fmt::format("fault: {}{} on {} begins, cycle {}", injection_kind_name(injection.kind),
                         injection.value ? fmt::format(" {:.6g}", *injection.value) : "",
                         injection.target, k),
             k);
      }
      if (!injection.until_s || !told_[i].has_begun || told_[i].has_ended || is_acting) continue;
      const double end_s = *injection.until_s + schedule_.onset_s(i) - injection.at_s;
      if (!is_between(t_s, end_s, std::nullopt)) continue;
      told_[i].has_ended = true;
      tell("info", "plant",
           fmt::format("fault: {} on {} ends, cycle {}", injection_kind_name(injection.kind),
                       injection.target, k),
           k);
    }
  }

  void watch(steady_clock::time_point now) {
    for (const MessageSilence::Report& report : silence_.look(now)) {
      tell(report.is_back ? "info" : "warning", "watchdog", report.text, cycle_);
    }
    if (bus_->is_up() == !is_down_) return;
    is_down_ = !is_down_;
    tell(is_down_ ? "error" : "info", "bus",
         fmt::format("bus {} is {}", bus_->name(),
                     is_down_ ? "down; waiting for its return" : "back"),
         cycle_);
  }

  void tell(const char* severity, const char* source, const std::string& text,
            std::int64_t cycle = -1) {
    publisher_->publish_event(cycle, severity, source, text, utime_now());
    options_.on_line(static_cast<double>(utime_now() - start_utime_) * 1e-6, text);
  }

  [[nodiscard]] RunCounters counters_now() const {
    RunCounters counters = result_.counters;
    const BusCounters bus = bus_->counters();
    counters.frames_sent = bus.sent;
    counters.send_errors = bus.send_errors;
    counters.frames_received = bus.received;
    counters.frames_dropped = bus.dropped;
    counters.records_dropped = cycles_.dropped();
    return counters;
  }

  void finish() {
    if (has_bus_failed_) {
      result_.stop_reason = {StopReason::Kind::kBus,
                             fmt::format("{} failed: {}", bus_->name(),
                                         std::generic_category().message(bus_->last_error()))};
    }
    if (result_.signal != 0) {
      publisher_->publish_event(cycle_, "warning", "plant", "stopped by a signal", utime_now());
    }
    if (result_.stop_reason) {
      publisher_->publish_event(cycle_, "error", "plant", result_.stop_reason->text, utime_now());
    }
    result_.counters = counters_now();
    result_.counters.clamped_values = plant_.clamped_values();
    result_.silences = silence_.silences();
    publisher_->publish_stats(result_.counters, {}, cycle_, utime_now(), true);
    publisher_->close();
  }

  struct Told {
    bool has_begun = false, has_ended = false;
  };

  const BenchInputs& inputs_;
  const PlantProcessOptions& options_;
  StopSignal stop_signal_;
  std::unique_ptr<CanBus> bus_;
  FaultSchedule schedule_;
  PlantNode plant_;
  FrameFaults faults_;
  PlantLoop loop_;
  MessageSilence silence_;
  SlotQueue<PlantCycle> cycles_;
  std::optional<LiveInjection> injection_;
  std::optional<RunPublisher> publisher_;
  std::int64_t start_utime_ = 0;
  steady_clock::time_point start_{};
  long cycles_per_second_ = 1;
  std::atomic<bool> must_stop_{false}, is_over_{false}, has_bus_failed_{false};
  std::int64_t cycle_ = 0;
  bool is_answered_ = false;
  bool is_down_ = false;
  std::vector<Told> told_;
  PlantProcessResult result_;
};

}  // namespace

PlantProcessResult run_plant_process(const BenchInputs& inputs,
                                     const PlantProcessOptions& options) {
  return PlantProcess(inputs, options).run();
}

}  // namespace faultline

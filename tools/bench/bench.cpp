#include "tools/bench/bench.h"

#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "drivers/can/bus_group.h"
#include "tools/bench/bench_run.h"

namespace faultline {
namespace {

using std::chrono::steady_clock;

/// A killed run loses about this much of its log.
constexpr auto kFlushPeriod = std::chrono::milliseconds(50);
constexpr auto kProgressPeriod = std::chrono::milliseconds(100);
/// Those who join live LCM late wait at most this long for RUN (docs/design.md).
constexpr auto kRepeatPeriod = std::chrono::seconds(5);
/// STATS once per second of bench time.
constexpr std::int64_t kStatsPeriod_us = 1'000'000;

std::int64_t utime_now() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

RunPublisher make_publisher(const BenchInputs& inputs, const BenchOptions& options,
                            const DiagnosisNode& diagnosis) {
  auto live = options.lcm_url ? open_live(*options.lcm_url) : nullptr;
  // The log comes last: nothing else may fail once an old log has been replaced.
  std::unique_ptr<MessageSink> log;
  if (options.log) {
    log = options.log_split.is_wanted() ? open_rotating_log(*options.log, options.log_split)
                                        : open_log(*options.log);
  }
  return {inputs, diagnosis.decision_table().sets(), std::move(log), std::move(live),
          options.has_estimates};
}

/// A real unit that answers must be on the bus.
void check_external_controller(const BenchInputs& inputs, const BenchOptions& options) {
  if (inputs.scenario.controller.kind != ControllerKind::kExternal || options.bus != "loop") return;
  throw std::invalid_argument(
      fmt::format("bus: found \"loop\", expected {}: the controller of scenario \"{}\" is "
                  "external, and loop lies within this process",
                  "a bus that it is on, e.g. can:vcan0", inputs.scenario.name));
}

}  // namespace

BenchRun::BenchRun(const BenchInputs& inputs_, const BenchOptions& options_)
    : inputs(inputs_),
      options(options_),
      buses(open_endpoints(options.bus, inputs.map, options.has_probe)),
      schedule(inputs.schedule),
      plant(inputs.make_plant(), inputs.map, schedule, inputs.bank.sample_time_s, inputs.x_initial,
            inputs.perturbations),
      controller(inputs.map, inputs.make_controller()),
      plant_faults(inputs.map, schedule, BenchNode::kPlant, inputs.bank.sample_time_s),
      controller_faults(inputs.map, schedule, BenchNode::kController, inputs.bank.sample_time_s),
      diagnosis(inputs.map, inputs.bank, inputs.is_initial_state_known),
      publisher(make_publisher(inputs, options, diagnosis)),
      history(inputs.bank, diagnosis.decision_table().sets(), inputs.scenario, schedule),
      watched_(buses_to_watch(*buses.diagnosis)),
      start_(steady_clock::now()),
      next_flush_(start_ + kFlushPeriod),
      next_progress_(start_),
      next_repeat_(start_ + kRepeatPeriod),
      start_utime_(utime_now()),
      cycle_count_(static_cast<std::uint32_t>(
                       std::lround(inputs.scenario.duration_s / inputs.bank.sample_time_s)) +
                   1),
      next_stats_utime_(start_utime_) {
  if (options.lcm_url && can_listen_to(*options.lcm_url)) {
    injection_.emplace(*options.lcm_url, schedule, inputs.bank.sample_time_s);
  }
  if (options.handles_signals) stop_signal.emplace();
  if (!buses.loop) backlog_.emplace();
  publisher.publish_parts(start_utime_);
  publisher.publish_event(
      -1, "info", "bench",
      fmt::format("{} on {}, {}, seed {}", inputs.scenario.name, options.bus,
                  options.is_realtime ? "in real time" : "in lock-step", inputs.scenario.seed),
      start_utime_);
  for (const std::string& warning : inputs.warnings) {
    publisher.publish_event(-1, "warning", "bench", warning, start_utime_);
  }
  for (const std::string& warning : inputs.perturbations.warnings()) {
    publisher.publish_event(-1, "warning", "bench", warning, start_utime_);
  }
}

std::int64_t BenchRun::utime_of(double t_s) const noexcept {
  return start_utime_ + std::llround(t_s * 1e6);
}

void BenchRun::on_record(const DiagnosisRecord& record, std::int64_t utime) {
  const FaultEstimate* estimate = publisher.publish_record(record, utime);
  history.on_record(record);
  if (options.on_record) options.on_record(record);
  if (estimate != nullptr) history.on_estimate(*estimate);
  ++seen_.samples;
  if ((record.flags & kBadSample) != 0) ++seen_.bad_samples;
  if ((record.flags & kSampleReset) != 0) {
    ++seen_.resets;
    publisher.publish_event(record.cycle, "warning", "diagnosis",
                            "restart or long gap on the bus: everything before is forgotten",
                            utime);
  }
}

std::vector<BenchRun::WatchedBus> BenchRun::buses_to_watch(const CanBus& bus) {
  const auto* const group = dynamic_cast<const BusGroup*>(&bus);
  if (group == nullptr) return {{.bus = &bus}};
  std::vector<WatchedBus> watched;
  for (std::size_t n = 0; n < group->size(); ++n) watched.push_back({.bus = &group->member(n)});
  return watched;
}

void BenchRun::on_frame(const CanFrame& frame, std::uint64_t number, std::int64_t utime) {
  publisher.add_frame(frame, number, utime);
  if (!frame.is_error || frame.bus >= watched_.size()) return;
  const ErrorReport report = read_error_frame(frame);
  WatchedBus& watched = watched_[frame.bus];
  if (!report.state || report.state == watched.state) return;
  watched.state = report.state;
  const char* severity = "info";
  if (report.state == ControllerState::kErrorWarning) severity = "warning";
  if (report.state == ControllerState::kErrorPassive) severity = "warning";
  if (report.state == ControllerState::kBusOff) severity = "error";
  publisher.publish_event(-1, severity, "bus",
                          fmt::format("{}: {}", watched.bus->name(), describe(report)), utime);
}

void BenchRun::watch_buses(double t_s, std::int64_t utime) {
  for (WatchedBus& watched : watched_) {
    const std::uint64_t outages = watched.bus->counters().outages;
    const bool is_down = !watched.bus->is_up();
    if (outages == watched.outages && is_down == watched.is_down) continue;
    const auto cycle = std::llround(t_s / inputs.bank.sample_time_s);
    const std::int64_t now = options.is_realtime ? utime_now() : utime;
    // An outage may be over before anybody looks: both its ends are told all the same.
    if (outages != watched.outages && !watched.is_down) {
      publisher.publish_event(cycle, "error", "bus",
                              fmt::format("bus {} is down", watched.bus->name()), now);
      watched.is_down = true;
    }
    watched.outages = outages;
    if (watched.is_down && !is_down) {
      publisher.publish_event(cycle, "info", "bus",
                              fmt::format("bus {} is back", watched.bus->name()), now);
      watched.is_down = false;
    }
  }
}

void BenchRun::poll_signal() {
  if (signal_ == 0 && stop_signal) signal_ = stop_signal->poll();
}

bool BenchRun::attend(double t_s, std::int64_t utime) {
  watch_buses(t_s, utime);
  const auto now = steady_clock::now();
  if (now >= next_flush_) {
    publisher.flush();
    next_flush_ = now + kFlushPeriod;
    poll_signal();
  }
  if (now >= next_repeat_) {
    publisher.repeat_parts();
    next_repeat_ = now + kRepeatPeriod;
  }
  if (options.on_progress && now >= next_progress_) {
    const std::string verdict =
        history.verdicts().empty() ? "" : verdict_text(history.verdicts().back());
    options.on_progress(t_s, inputs.scenario.duration_s, verdict);
    next_progress_ = now + kProgressPeriod;
  }
  return signal_ != 0 || stop_reason_.has_value();
}

void BenchRun::take_injections(std::uint32_t free_cycle, std::int64_t utime) {
  if (!injection_) return;
  injection_->attend(free_cycle, [&](const char* severity, const std::string& text) {
    publisher.publish_event(free_cycle, severity, "inject", text, utime);
    publisher.flush();
  });
}

void BenchRun::on_truth(const PlantTruth& truth, const Eigen::VectorXd& x, std::int64_t utime) {
  publisher.publish_truth(truth, schedule, x, utime);
  ++seen_.cycles;
  if (truth.is_late) ++seen_.late_cycles;
  if (is_stats_due(utime)) {
    publisher.publish_stats(counters_now(), latencies, truth.cycle, utime, false);
    next_stats_utime_ = utime + kStatsPeriod_us;
  }
}

RunCounters BenchRun::counters_now() const {
  RunCounters counters = seen_;
  const BusCounters from_plant = buses.plant->counters();
  const BusCounters from_controller = buses.controller->counters();
  const BusCounters at_diagnosis = buses.diagnosis->counters();
  counters.frames_sent = from_plant.sent + from_controller.sent;
  counters.send_errors = from_plant.send_errors + from_controller.send_errors;
  counters.frames_received = at_diagnosis.received;
  counters.frames_dropped = at_diagnosis.dropped;
  counters.frames_unlogged = pace_.frames_unlogged;
  counters.overruns = pace_.overruns;
  counters.skipped_cycles = pace_.skipped_cycles;
  counters.records_dropped = pace_.records_dropped;
  counters.allocations = pace_.allocations;
  counters.page_faults = pace_.page_faults;
  return counters;
}

BenchResult BenchRun::finish(std::int64_t utime) {
  poll_signal();
  watch_buses(time_of(plant.truth().cycle), utime);
  publisher.flush_frames();
  if (signal_ != 0) {
    publisher.publish_event(plant.truth().cycle, "warning", "bench", "stopped by a signal", utime);
  }
  if (stop_reason_) {
    publisher.publish_event(plant.truth().cycle, "error", "bench", stop_reason_->text, utime);
  }
  RunCounters final_counters = counters_now();
  final_counters.clamped_values = plant.clamped_values() + controller.clamped_values();
  final_counters.frame_faults = plant_faults.counters() + controller_faults.counters();
  final_counters.backlog_drops = backlog_ ? backlog_->drops() : 0;
  if (final_counters.backlog_drops > 0) {
    publisher.publish_event(plant.truth().cycle, "warning", "bus",
                            backlog_drops_text(final_counters.backlog_drops), utime);
  }
  publisher.publish_stats(final_counters, latencies, plant.truth().cycle, utime, true);
  publisher.close();
  const std::chrono::duration<double> wall = steady_clock::now() - start_;
  return {.history = std::move(history),
          .counters = final_counters,
          .messages = diagnosis.message_counters(),
          .latencies = std::move(latencies),
          .is_interrupted = signal_ != 0,
          .signal = signal_,
          .stop_reason = stop_reason_,
          .wall_s = wall.count()};
}

BenchResult run_bench(const BenchInputs& inputs, const BenchOptions& options) {
  check_external_controller(inputs, options);
  BenchRun run(inputs, options);
  if (options.is_realtime) {
    run_realtime(run);
  } else {
    run_lock_step(run);
  }
  const double t_end_s = run.time_of(run.plant.truth().cycle);
  return run.finish(options.is_realtime ? utime_now() : run.utime_of(t_end_s));
}

}  // namespace faultline

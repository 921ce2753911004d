#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/can/error_frame.h"
#include "drivers/can/input_backlog.h"
#include "sim/controller_node.h"
#include "sim/frame_faults.h"
#include "sim/plant_node.h"
#include "tools/bench/bench.h"
#include "tools/bench/bench_inputs.h"
#include "tools/bench/diagnosis_node.h"
#include "tools/bench/endpoints.h"
#include "tools/bench/live_injection.h"
#include "tools/bench/run_history.h"
#include "tools/bench/run_publisher.h"
#include "tools/bench/stop_signal.h"

namespace faultline {

/// Counted by the pace of a run in real time.
struct PaceCounters {
  std::uint64_t overruns = 0;        ///< cycles that began a whole period late
  std::uint64_t skipped_cycles = 0;  ///< of these, cycles that were not sent
  std::uint64_t records_dropped = 0;
  std::uint64_t frames_unlogged = 0;
  std::optional<std::uint64_t> allocations, page_faults;
};

/// One run in the making: the nodes wired to a bus, the publisher, the history. How the cycles are
/// paced is not its business: run_lock_step and run_realtime drive it.
class BenchRun {
 public:
  /// @throws BusError, MessageSinkError, std::invalid_argument.
  BenchRun(const BenchInputs& inputs, const BenchOptions& options);

  // Consumer side: called by one thread only, the one that publishes.

  /// A frame the diagnosis node received, and its running number there. What an error frame says of
  /// the controller's state becomes an EVENT.
  void on_frame(const CanFrame& frame, std::uint64_t number, std::int64_t utime);
  void on_record(const DiagnosisRecord& record, std::int64_t utime);
  void on_truth(const PlantTruth& truth, const Eigen::VectorXd& x, std::int64_t utime);
  /// Call often, with the time the run has come to: flushes, repeats RUN, shows progress, polls the
  /// stop signal. @return true if the run must stop.
  bool attend(double t_s, std::int64_t utime);
  /// Faults injected live, and an EVENT for each request. Call often, with a cycle that no node has
  /// begun nor will have before this returns: from there they act.
  void take_injections(std::uint32_t free_cycle, std::int64_t utime);
  /// Last counters and a clean end of log and LCM.
  /// Nodes and buses must be at rest.
  [[nodiscard]] BenchResult finish(std::int64_t utime);
  /// Whether `on_truth` of that time will publish STATS, and so `latencies`.
  [[nodiscard]] bool is_stats_due(std::int64_t utime) const noexcept {
    return utime >= next_stats_utime_;
  }
  /// What the pace alone knows, since the start.
  void set_pace_counters(const PaceCounters& counters) noexcept { pace_ = counters; }

  /// Microseconds since 1970 at which the run began.
  [[nodiscard]] std::int64_t start_utime() const noexcept { return start_utime_; }
  [[nodiscard]] std::int64_t utime_of(double t_s) const noexcept;
  [[nodiscard]] double time_of(std::uint32_t cycle) const noexcept {
    return cycle * inputs.bank.sample_time_s;
  }
  /// Cycles 0 .. cycle_count-1: from 0 to duration_s, both included.
  [[nodiscard]] std::uint32_t cycle_count() const noexcept { return cycle_count_; }

  /// Ends the run early and says why.
  void stop(StopReason reason) { stop_reason_ = std::move(reason); }

  const BenchInputs& inputs;
  const BenchOptions& options;
  std::optional<StopSignal> stop_signal;
  Endpoints buses;
  FaultSchedule schedule;  ///< of this run: faults may be added while it goes on
  PlantNode plant;
  ControllerNode controller;
  FrameFaults plant_faults, controller_faults;  ///< between these nodes and their buses
  DiagnosisNode diagnosis;
  RunPublisher publisher;
  RunHistory history;
  std::vector<StageLatency> latencies;  ///< kept by the pace, in real time; for STATS

 private:
  /// A bus as the diagnosis node sees it, and what was last said of it.
  struct WatchedBus {
    const CanBus* bus = nullptr;
    std::uint64_t outages = 0;
    bool is_down = false;
    std::optional<ControllerState> state;
  };

  void poll_signal();
  /// An EVENT for each outage's begin and end. Their time is the wall clock's in real time, as no
  /// frame comes during an outage.
  void watch_buses(double t_s, std::int64_t utime);
  [[nodiscard]] static std::vector<WatchedBus> buses_to_watch(const CanBus& bus);
  /// Counters as they stand, from the buses and from what came by here.
  [[nodiscard]] RunCounters counters_now() const;

  std::optional<LiveInjection> injection_;  ///< where there is live LCM
  std::vector<WatchedBus> watched_;
  std::optional<InputBacklogWatch> backlog_;  ///< where the bus is the kernel's
  std::chrono::steady_clock::time_point start_, next_flush_, next_progress_, next_repeat_;
  std::int64_t start_utime_;
  std::uint32_t cycle_count_;
  RunCounters seen_;  ///< of truths and records
  PaceCounters pace_;
  std::int64_t next_stats_utime_;
  int signal_ = 0;
  std::optional<StopReason> stop_reason_;
};

/// Cycle k+1 begins when the commands of cycle k are complete: as fast as the machine can, on any
/// bus, and equal to the bit on all of them. One thread.
void run_lock_step(BenchRun& run);

/// Cycles begin at absolute deadlines; plant, controller and diagnosis have a thread each, the
/// calling thread publishes.
void run_realtime(BenchRun& run);

}  // namespace faultline

#pragma once

#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "tools/bench/bench_inputs.h"
#include "tools/bench/diagnosis_record.h"
#include "tools/bench/latency_histogram.h"
#include "tools/bench/run_history.h"
#include "tools/bench/run_publisher.h"
#include "tools/lcm/rotating_log.h"

namespace faultline {

/// What a cycle in real time does that could begin only a whole period or more after its deadline.
/// The deadlines stay where they are.
enum class OverrunPolicy {
  kCatchUp,  ///< it follows at once, and so do the next until the deadlines are met again
  kSkip,     ///< the plant goes on, but nothing is sent: as a real unit that missed its turn
  kStop,     ///< the run ends
};

struct BenchOptions {
  std::string bus;           ///< "loop", or what open_bus opens
  bool is_realtime = false;  ///< absolute deadlines; else lock-step
  /// How long a run in lock-step waits for a bus that is down, or takes nothing, before it ends. In
  /// real time the cycles go on and the run ends at its time.
  std::chrono::nanoseconds bus_patience = std::chrono::seconds(10);
  OverrunPolicy overrun = OverrunPolicy::kCatchUp;
  /// SCHED_FIFO priority of the diagnosis thread, 1 .. 99; plant and controller have one and two
  /// less. With it go locked memory and awake CPUs. 0: ordinary scheduling, nothing asked for.
  int priority = 0;
  std::optional<int> cpu;  ///< that the diagnosis thread is bound to
  /// In real time: a thread beside the diagnosis that does nothing but read the bus, to compare.
  bool has_probe = false;
  // Capacity of the queues from the diagnosis thread to the publisher.
  std::size_t frame_slots = 8192;   ///< two seconds of a 1 kHz bench with four frames per cycle
  std::size_t record_slots = 1024;  ///< one second of it
  /// Heap calls of the calling thread so far; null: they are not counted.
  std::uint64_t (*thread_allocations)() noexcept = nullptr;
  std::optional<std::filesystem::path> log;
  LogSplit log_split;  ///< of `log`: then in files of its own (rotating_log.h)
  std::optional<std::string> lcm_url;
  /// SIGINT and SIGTERM end the run cleanly; false where the caller minds them, e.g. for many runs
  /// side by side.
  bool handles_signals = true;
  /// Sizes of isolated faults are estimated; a log or LCM carries them, and expectations ask for
  /// them.
  bool has_estimates = true;
  /// Told each sample's record, on the thread that publishes.
  std::function<void(const DiagnosisRecord& record)> on_record;
  /// Called about ten times a second while the bench runs; on the calling thread.
  std::function<void(double t_s, double duration_s, const std::string& verdict)> on_progress;
  /// Told what keeps the run from being in real time as it should; on the calling thread.
  std::function<void(const std::string& text)> on_warning;
};

/// Why a run ended before its time.
struct StopReason {
  enum class Kind {
    kBus,      ///< the bus failed or lost what the cycle cannot go on without
    kPlant,    ///< the plant diverged
    kOverrun,  ///< a cycle was late, and OverrunPolicy::kStop
  };
  Kind kind = Kind::kBus;
  std::string text;
};

/// What a run came to.
struct BenchResult {
  RunHistory history;
  RunCounters counters;
  /// What the diagnosis saw of each message, by its index in the SignalMap.
  std::vector<MessageCounters> messages{};
  std::vector<StageLatency> latencies{};  ///< empty after a run in lock-step
  bool is_interrupted = false;            ///< stopped by SIGINT or SIGTERM
  int signal = 0;                         ///< which
  std::optional<StopReason> stop_reason;  ///< why it ended early otherwise
  double wall_s = 0.0;
};

/// Runs a scenario: plant, controller and diagnosis nodes on one bus, in lock-step (cycle k+1
/// begins when the commands of cycle k are complete) or in real time. Handles SIGINT and SIGTERM:
/// stops cleanly, log closed.
/// @throws BusError, MessageSinkError the bus, the log or LCM failed; std::invalid_argument bus
/// name, or the bus loop with an external controller.
[[nodiscard]] BenchResult run_bench(const BenchInputs& inputs, const BenchOptions& options);

}  // namespace faultline

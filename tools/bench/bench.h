#pragma once

#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "tools/bench/bench_inputs.h"
#include "tools/bench/run_history.h"
#include "tools/bench/run_publisher.h"
#include "tools/lcm/rotating_log.h"

namespace faultline {

struct BenchOptions {
  std::string bus;           ///< "loop", or what open_bus opens
  bool is_realtime = false;  ///< absolute deadlines; else lock-step
  /// How long a run in lock-step waits for a bus that is down, or takes nothing, before it ends. In
  /// real time the cycles go on and the run ends at its time.
  std::chrono::nanoseconds bus_patience = std::chrono::seconds(10);
  std::optional<std::filesystem::path> log;
  LogSplit log_split;  ///< of `log`: then in files of its own (rotating_log.h)
  std::optional<std::string> lcm_url;
  /// Called about ten times a second while the bench runs; on the calling thread.
  std::function<void(double t_s, double duration_s, const std::string& verdict)> on_progress;
};

/// Why a run ended before its time.
struct StopReason {
  enum class Kind {
    kBus,    ///< the bus failed or lost what the cycle cannot go on without
    kPlant,  ///< the plant diverged
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
  bool is_interrupted = false;            ///< stopped by SIGINT or SIGTERM
  int signal = 0;                         ///< which
  std::optional<StopReason> stop_reason;  ///< why it ended early otherwise
  double wall_s = 0.0;
};

/// Runs a scenario: plant, controller and diagnosis nodes on one bus, in lock-step (cycle k+1
/// begins when the commands of cycle k are complete) or in real time. Handles SIGINT and SIGTERM:
/// stops cleanly, log closed.
/// @throws BusError, MessageSinkError the bus, the log or LCM failed; std::invalid_argument bus
/// name.
[[nodiscard]] BenchResult run_bench(const BenchInputs& inputs, const BenchOptions& options);

}  // namespace faultline

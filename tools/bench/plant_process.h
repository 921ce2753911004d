#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tools/bench/bench.h"
#include "tools/bench/bench_inputs.h"
#include "tools/bench/run_publisher.h"

namespace faultline {

struct PlantProcessOptions {
  std::string bus;  ///< what open_bus opens
  /// Cycles 0 .. cycle_count-1.
  std::uint32_t cycle_count = std::numeric_limits<std::uint32_t>::max();
  OverrunPolicy overrun = OverrunPolicy::kCatchUp;
  std::optional<std::filesystem::path> log;
  std::optional<std::string> lcm_url;  ///< TRUTH, EVENT and STATS; takes INJECT
  /// Told what a person should know as it happens; on the calling thread.
  std::function<void(double t_s, const std::string& text)> on_line = [](double,
                                                                        const std::string&) {};
};

/// A fault that acted.
struct ActedFault {
  std::string target, kind;
  std::uint32_t from_cycle = 0;
};

struct PlantProcessResult {
  RunCounters counters;  ///< frames_received: commands
  std::vector<ActedFault> faults;
  std::uint64_t silences = 0;  ///< times that commands ceased to come
  int signal = 0;              ///< that stopped it, 0 if none did
  std::optional<StopReason> stop_reason;
};

/// The plant alone, in real time, on a bus where the controller and the diagnosis are other
/// processes: it leads the cycle from k = 0 on, with all of the scenario's timeline that is the
/// plant's. A thread of its own keeps the cycle; the calling one publishes.
/// @throws BusError, MessageSinkError, MessageSourceError, std::invalid_argument as run_bench.
[[nodiscard]] PlantProcessResult run_plant_process(const BenchInputs& inputs,
                                                   const PlantProcessOptions& options);

}  // namespace faultline

#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "drivers/can/can_bus.h"
#include "tools/bench/bench_inputs.h"

namespace faultline {

struct ControllerProcessOptions {
  std::string bus;                  ///< what open_bus opens
  std::optional<double> seconds{};  ///< to run; nothing: until a signal
  /// Told what a person should know as it happens; on the calling thread.
  std::function<void(double t_s, const std::string& text)> on_line = [](double,
                                                                        const std::string&) {};
};

struct ControllerProcessResult {
  BusCounters bus;
  std::uint64_t cycles = 0;          ///< that a measurement began
  std::uint64_t clamped_values = 0;  ///< commands that did not fit their signals
  std::uint64_t restarts = 0;        ///< times that the plant began anew
  std::uint64_t silences = 0;        ///< times that measurements ceased to come
  int signal = 0;                    ///< that stopped it, 0 if none did
};

/// The controller alone, on a bus where the plant is another process: answers each measurement.
/// Where k goes back the plant has begun anew, and so does the control law. A bus that is down is
/// waited for. One thread.
/// @throws BusError the bus failed; std::invalid_argument no such bus.
[[nodiscard]] ControllerProcessResult run_controller_process(
    const BenchInputs& inputs, const ControllerProcessOptions& options);

}  // namespace faultline

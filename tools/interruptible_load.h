#pragma once

#include <filesystem>
#include <optional>

#include "tools/bench/bench_inputs.h"
#include "tools/bench/stop_signal.h"

namespace faultline {

/// Reads a scenario and all it refers to on a thread of its own, as a design may take minutes.
/// @param plant_library as of load_bench_inputs
/// @return nullopt: a signal came first. The thread goes on until the process ends, so the process
///   must then end by std::_Exit.
/// @throws what load_bench_inputs throws.
[[nodiscard]] std::optional<BenchInputs> load_until_signal(
    const std::filesystem::path& file, StopSignal& stop,
    const std::filesystem::path& plant_library = {});

}  // namespace faultline

#pragma once

#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "tools/bench/bench.h"
#include "tools/bench/bench_inputs.h"

namespace faultline {

/// The result of a run for people: injected faults beside diagnosed ones with delays, first
/// crossings, frames, late cycles, expectations, where the log is.
void print_summary(std::FILE* out, const BenchInputs& inputs, const BenchOptions& options,
                   const BenchResult& result);

/// The same as data: what `faultline run --json` writes.
[[nodiscard]] nlohmann::ordered_json summary_json(const BenchInputs& inputs,
                                                  const BenchOptions& options,
                                                  const BenchResult& result);

// Parts of it, also for a diagnosis that only listens.

/// Messages whose counter or checksum found something.
void print_integrity(std::FILE* out, const SignalMap& map,
                     const std::vector<MessageCounters>& messages);
void print_dbc_warnings(std::FILE* out, const std::vector<std::string>& warnings);
[[nodiscard]] nlohmann::ordered_json message_json(const std::string& name,
                                                  const MessageCounters& counters);

}  // namespace faultline

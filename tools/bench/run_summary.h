#pragma once

#include <cstdio>
#include <optional>
#include <string>

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

}  // namespace faultline

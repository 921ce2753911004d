#pragma once

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "tools/bench/latency_histogram.h"

namespace faultline {

class latency_histogram_t;

/// A line per stage with a value: how many, p50, p90, p99, p99.9 and the longest, in µs; says which
/// stages are measured in one of several cycles, and which hold values filled in. Each line begins
/// with two spaces and ends with a line feed. Empty if no stage has a value.
[[nodiscard]] std::string latency_table(const std::vector<StageLatency>& stages);

/// The same as data: an array of objects, one per stage.
[[nodiscard]] nlohmann::ordered_json latency_json(const std::vector<StageLatency>& stages);

/// What STATS carries of one stage. Takes whatever a log may contain.
[[nodiscard]] StageLatency to_stage_latency(const latency_histogram_t& message);

}  // namespace faultline

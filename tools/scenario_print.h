#pragma once

#include <cstdio>

#include <nlohmann/json_fwd.hpp>

#include "tools/bench/scenario.h"

namespace faultline {

/// A scenario for people: what it is made from, its timeline in the order of time, what it expects.
void print_scenario(std::FILE* out, const Scenario& scenario);

/// The same as data: what `faultline info --json` writes.
[[nodiscard]] nlohmann::ordered_json scenario_json(const Scenario& scenario);

}  // namespace faultline

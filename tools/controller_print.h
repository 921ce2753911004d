#pragma once

#include <cstdio>

#include <nlohmann/json_fwd.hpp>

#include "tools/bench/scenario.h"

namespace faultline {

/// What the controller of a scenario is: kind, gains, observer poles, loops, what it follows, and
/// the largest pole of the closed loop. Of the kind alone where plant or bank are not there.
/// @return the same as JSON.
/// @throws InputError as plan_controller; what reading plant and bank throws.
nlohmann::ordered_json print_controller(std::FILE* out, const Scenario& scenario);

}  // namespace faultline

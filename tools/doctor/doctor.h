#pragma once

#include <vector>

#include "tools/doctor/finding.h"

namespace faultline {

/// Looks at all that the bench needs of a machine: buses, LCM, scheduling, clocks. Changes nothing
/// that outlives it; takes about a second.
[[nodiscard]] std::vector<Finding> examine_machine();

/// Whether nothing that the bench needs is missing.
[[nodiscard]] bool is_fit(const std::vector<Finding>& findings) noexcept;

}  // namespace faultline

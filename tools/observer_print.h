#pragma once

#include <cstdio>

#include <nlohmann/json_fwd.hpp>

#include "diagnosis/design/design_bank.h"

namespace faultline {

/// What was tried for each observer, what was taken, and why the others were not.
void print_observers(std::FILE* out, const DesignResult& result);

/// Per observer filter: bounds, β, radii at the vertices, thresholds, smallest faults.
void print_observer_proofs(std::FILE* out, const Bank& bank);

/// The proofs as data: one object per observer filter.
[[nodiscard]] nlohmann::ordered_json observer_filters_json(const Bank& bank);

/// The trials as data: one object per observer.
[[nodiscard]] nlohmann::ordered_json observers_json(const DesignResult& result);

}  // namespace faultline

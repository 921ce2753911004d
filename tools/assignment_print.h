#pragma once

#include <cstdio>

#include <nlohmann/json_fwd.hpp>

#include "diagnosis/design/design_bank.h"

namespace faultline {

/// Method "eigenstructure": per residual how the unknown inputs are kept out of it, and why so; of
/// compromises the singular values, what was taken for zero, the gain before and after, and what
/// more rows would be worth.
void print_assignments(std::FILE* out, const DesignResult& result);

/// The same as data: one object per residual that was asked for.
[[nodiscard]] nlohmann::ordered_json assignments_json(const DesignResult& result);

}  // namespace faultline

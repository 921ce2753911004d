#pragma once

#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"

namespace faultline {

// What a filter has beyond a plain linear one, as text: an observer's, and the course of certified
// thresholds of any filter. Private to diagnosis/bank.

/// True if it has anything of that: only then is there an "observer" in its text, so that the text
/// of other filters is what it was before there were observers.
[[nodiscard]] bool is_observer(const ResidualFilter& filter);

/// The JSON object "observer" of a filter.
[[nodiscard]] std::string observer_text(const Bank& bank, const ResidualFilter& filter);

/// names[i] of all indices.
[[nodiscard]] std::vector<std::string> names_of(const std::vector<std::string>& names,
                                                const std::vector<std::size_t>& indices);

}  // namespace faultline

#pragma once

#include <optional>
#include <string>

#include "tools/score/scorecard.h"

namespace faultline {

// What numbers of a scorecard are called and how they are written; for text and page alike.

/// "93.2 % (91.0 .. 95.1)"; "-" without a value.
[[nodiscard]] std::string percent_text(const std::optional<Estimate>& share);
/// "40 ms (30 .. 50)", "never" where less than that share was found; "-".
[[nodiscard]] std::string delay_text(const std::optional<Estimate>& delay_s);
/// "0 per h (0 .. 0.54)".
[[nodiscard]] std::string rate_text(const std::optional<Estimate>& rate);
/// "0.50 (0.49 .. 0.52)", "at most 0.1", "above 4", "not known".
[[nodiscard]] std::string size_text(const DetectableSize& size);
/// What the design promised, or "-".
[[nodiscard]] std::string predicted_text(const std::optional<double>& size);

}  // namespace faultline

#pragma once

#include <optional>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "tools/bench/run_history.h"

namespace faultline {

/// What a RunHistory tells, as data: parts of every summary.
[[nodiscard]] nlohmann::ordered_json verdict_json(const VerdictEntry& entry);
[[nodiscard]] nlohmann::ordered_json expectation_json(const ExpectationOutcome& outcome);
[[nodiscard]] nlohmann::ordered_json seconds_or_null(const std::optional<double>& value_s);

/// "NOT MET 4.3 .. 10 s  isolated u2, u3; found healthy at 4.3 s".
[[nodiscard]] std::string expectation_text(const ExpectationOutcome& outcome);

}  // namespace faultline

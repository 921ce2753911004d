#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "tools/bench/scenario_outcome.h"

namespace faultline {

/// The outcomes as JUnit XML: a <testsuite> per scenario with a <testcase> per [[expect]], the
/// failure's text in it. A run that ended early and a scenario that cannot be run are errors in a
/// test case of their own ("run"); what such a run left open is skipped. Times are wall time, a
/// suite's shared by its test cases.
[[nodiscard]] std::string junit_xml(const std::vector<ScenarioOutcome>& outcomes);

/// `text` as XML character data: markup escaped; what XML 1.0 or UTF-8 does not allow becomes
/// U+FFFD.
[[nodiscard]] std::string xml_escaped(std::string_view text);

}  // namespace faultline

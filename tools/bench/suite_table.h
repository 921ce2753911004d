#pragma once

#include <cstddef>
#include <cstdio>
#include <string>
#include <vector>

#include "tools/bench/scenario_outcome.h"

namespace faultline {

/// How a table is to look.
struct TableStyle {
  std::size_t width = 0;    ///< columns of the terminal; 0: none, a line may be as long as it likes
  bool has_colour = false;  ///< ANSI colours
};
/// That of a stream: the width and colours of its terminal, colours unless NO_COLOR is set. Plain
/// where it is none.
[[nodiscard]] TableStyle style_of(std::FILE* out);

/// A line per scenario: expectations met of how many, cycles per second, wall time and the verdicts
/// one after the other; below it what was not met, why the others did not run, and the sum.
[[nodiscard]] std::string suite_table(const std::vector<ScenarioOutcome>& outcomes,
                                      const TableStyle& style);

/// "1.31 healthy  4.07 isolated u2, u3": when each verdict began, but for the start that every run
/// has; in `width` columns the last ones and how many are not shown.
[[nodiscard]] std::string verdict_timeline(const std::vector<VerdictEntry>& verdicts,
                                           std::size_t width);

}  // namespace faultline

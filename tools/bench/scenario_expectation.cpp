#include <algorithm>

#include <fmt/format.h>

#include "tools/bench/scenario_tables.h"

namespace faultline {

Expectation read_expectation(TomlTable table, double duration_s) {
  Expectation expectation;
  expectation.from_s = require_time(table, "from_s", table.number("from_s"));
  expectation.until_s = table.number("until_s");
  if (expectation.until_s < expectation.from_s) {
    throw table.error("until_s", fmt::format("found {}, expected at least from_s = {}",
                                             expectation.until_s, expectation.from_s));
  }
  if (expectation.from_s > duration_s) {
    throw table.error("from_s", fmt::format("found {}, expected at most duration_s = {}",
                                            expectation.from_s, duration_s));
  }
  const std::string verdict =
      table.choice("verdict", {"healthy", "isolated", "ambiguous", "unexplained", "inhibited"});
  for (const Verdict candidate : {Verdict::kHealthy, Verdict::kIsolated, Verdict::kAmbiguous,
                                  Verdict::kUnexplained, Verdict::kInhibited}) {
    if (verdict == verdict_name(candidate)) expectation.verdict = candidate;
  }
  if (expectation.verdict == Verdict::kIsolated) {
    expectation.faults = table.strings("faults");
    if (expectation.faults.empty()) {
      throw table.error("faults", "found an empty list, expected the isolated faults");
    }
    std::sort(expectation.faults.begin(), expectation.faults.end());
  } else if (table.has("faults")) {
    throw table.error("faults", fmt::format("found a list, expected none: only the verdict "
                                            "\"isolated\" names faults, this one is \"{}\"",
                                            verdict));
  }
  return expectation;
}

}  // namespace faultline

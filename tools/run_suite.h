#pragma once

#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "tools/bench/bench.h"
#include "tools/bench/bench_inputs.h"
#include "tools/bench/scenario_outcome.h"

namespace faultline {

struct SuiteOptions {
  /// Options of the run of one scenario; may add to its parts.
  std::function<BenchOptions(BenchInputs&)> bench_options;
  bool is_quiet = false;  ///< no progress on stderr
  std::string json;       ///< file, "-" for stdout; empty: none
  std::string junit;      ///< likewise
};

/// Runs one scenario after the other, whatever becomes of each, and prints one table. SIGINT and
/// SIGTERM end it with what is there so far. @return the exit code
/// @throws OutputError a report cannot be written.
int run_suite(const std::vector<std::filesystem::path>& files, const SuiteOptions& options);

/// What ended a run before its time, in a sentence; empty if nothing did.
[[nodiscard]] std::string early_end_text(const BenchResult& result);
/// The exit code of a run (ExitCode).
[[nodiscard]] int exit_code_of(const BenchResult& result);
/// Writes JUnit XML to `target`: a file, or "-" for stdout. @throws OutputError.
void write_junit(const std::vector<ScenarioOutcome>& outcomes, const std::string& target);

}  // namespace faultline

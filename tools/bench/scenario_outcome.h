#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "tools/bench/bench.h"

namespace faultline {

/// What became of one scenario of a suite.
struct ScenarioOutcome {
  enum class Status {
    kMet,          ///< every expectation was met, or there is none
    kNotMet,       ///< one was not
    kStopped,      ///< the run ended before its time (BenchResult::stop_reason)
    kInterrupted,  ///< by a signal
    kNotRun,       ///< bad input, or a bank that does not exist: see `error`
  };

  std::filesystem::path file;
  std::string name;                   ///< of the scenario; of the file where it could not be read
  std::optional<BenchResult> result;  ///< none: it was not run
  std::string error;                  ///< why it was not run, or ended early
  int exit_code = 0;                  ///< that of a run of this scenario alone (ExitCode)
  double wall_s = 0.0;

  [[nodiscard]] Status status() const;
};

/// An expectation of a run: the outcome, and whether the run came to its end.
struct DecidedExpectation {
  ExpectationOutcome outcome;
  bool is_decided = false;  ///< false: the run ended before the answer was known
  [[nodiscard]] bool is_met() const noexcept { return is_decided && outcome.is_met; }
};
[[nodiscard]] std::vector<DecidedExpectation> decided_expectations(const ScenarioOutcome& outcome);

/// Counts over the scenarios of a suite.
struct SuiteTally {
  std::size_t met = 0, not_met = 0, stopped = 0, interrupted = 0, not_run = 0;
  std::size_t expectations = 0, expectations_met = 0;
};
[[nodiscard]] SuiteTally tally_of(const std::vector<ScenarioOutcome>& outcomes);

/// "met", "NOT MET", "STOPPED", "INTERRUPTED", "NOT RUN".
[[nodiscard]] std::string_view status_name(ScenarioOutcome::Status status) noexcept;

}  // namespace faultline

#include "tools/bench/scenario_outcome.h"

#include <algorithm>

namespace faultline {

ScenarioOutcome::Status ScenarioOutcome::status() const {
  if (!result) return Status::kNotRun;
  if (result->is_interrupted) return Status::kInterrupted;
  if (result->stop_reason) return Status::kStopped;
  return result->history.are_expectations_met() ? Status::kMet : Status::kNotMet;
}

std::vector<DecidedExpectation> decided_expectations(const ScenarioOutcome& outcome) {
  std::vector<DecidedExpectation> decided;
  if (!outcome.result) return decided;
  const bool is_whole = !outcome.result->is_interrupted && !outcome.result->stop_reason;
  for (const ExpectationOutcome& expectation : outcome.result->history.expectations()) {
    decided.push_back({expectation, is_whole || expectation.is_final});
  }
  return decided;
}

SuiteTally tally_of(const std::vector<ScenarioOutcome>& outcomes) {
  SuiteTally tally;
  for (const ScenarioOutcome& outcome : outcomes) {
    switch (outcome.status()) {
      case ScenarioOutcome::Status::kMet:
        ++tally.met;
        break;
      case ScenarioOutcome::Status::kNotMet:
        ++tally.not_met;
        break;
      case ScenarioOutcome::Status::kStopped:
        ++tally.stopped;
        break;
      case ScenarioOutcome::Status::kInterrupted:
        ++tally.interrupted;
        break;
      case ScenarioOutcome::Status::kNotRun:
        ++tally.not_run;
        break;
    }
    for (const DecidedExpectation& expectation : decided_expectations(outcome)) {
      ++tally.expectations;
      if (expectation.is_met()) ++tally.expectations_met;
    }
  }
  return tally;
}

std::string_view status_name(ScenarioOutcome::Status status) noexcept {
  switch (status) {
    case ScenarioOutcome::Status::kMet:
      return "met";
    case ScenarioOutcome::Status::kNotMet:
      return "NOT MET";
    case ScenarioOutcome::Status::kStopped:
      return "STOPPED";
    case ScenarioOutcome::Status::kInterrupted:
      return "INTERRUPTED";
    case ScenarioOutcome::Status::kNotRun:
      break;
  }
  return "NOT RUN";
}

}  // namespace faultline

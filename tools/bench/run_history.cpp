#include "tools/bench/run_history.h"

#include <algorithm>

#include <fmt/format.h>

namespace faultline {
namespace {

/// Slack for comparing cycle times with times written in a file: half a nanosecond.
constexpr double kTimeSlack_s = 0.5e-9;

bool agrees(const Expectation& expectation, const VerdictEntry& now) {
  if (now.verdict != expectation.verdict) return false;
  return now.verdict != Verdict::kIsolated || now.sets.front() == expectation.faults;
}

}  // namespace

RunHistory::RunHistory(const Bank& bank, const std::vector<std::vector<std::size_t>>& fault_sets,
                       const Scenario& scenario, const FaultSchedule& schedule)
    : bank_(&bank),
      fault_sets_(&fault_sets),
      schedule_(&schedule),
      first_fired_s_(bank.filters.size()) {
  active_.resize(schedule.injections().size());
  for (const Expectation& expectation : scenario.expectations) {
    expectations_.push_back({.expectation = expectation});
  }
}

VerdictEntry RunHistory::entry_of(const Decision& decision, double t_s) const {
  VerdictEntry entry{t_s, decision.verdict, {}};
  const std::size_t listed = std::min<std::size_t>(decision.set_count, Decision::kMaxListed);
  for (std::size_t i = 0; i < listed; ++i) {
    std::vector<std::string>& names = entry.sets.emplace_back();
    for (const std::size_t fault : (*fault_sets_)[decision.sets[i]]) {
      names.push_back(bank_->fault_names[fault]);
    }
    std::sort(names.begin(), names.end());
  }
  return entry;
}

void RunHistory::on_record(const DiagnosisRecord& record) {
  ++samples_;
  const double t_s = record.cycle * bank_->sample_time_s;
  const bool is_change = !last_decision_ || record.decision != *last_decision_;
  if (is_change) {
    last_decision_ = record.decision;
    now_ = entry_of(record.decision, t_s);
    verdicts_.push_back(now_);
  }
  now_.t_s = t_s;
  for (std::size_t i = 0; i < record.fired.size(); ++i) {
    if (record.fired[i] != 0 && !first_fired_s_[i]) first_fired_s_[i] = t_s;
  }
  follow_injections(is_change);
  check_expectations();
}

void RunHistory::follow_injections(bool is_change) {
  for (std::size_t i = 0; i < active_.size(); ++i) {
    active_[i] = activity(schedule_->injections()[i], now_.t_s) > 0.0 ? 1 : 0;
  }
  if (injections_.empty() || active_ != active_before_) {
    active_before_ = active_;
    std::vector<std::string> faults = schedule_->active_names(now_.t_s);
    if (injections_.empty() || injections_.back().faults != faults) {
      injections_.push_back({.from_s = now_.t_s, .faults = std::move(faults)});
    }
  }
  InjectionOutcome& outcome = injections_.back();
  outcome.until_s = now_.t_s;
  if (is_change) {
    const double delay_s = now_.t_s - outcome.from_s;
    const bool is_alarm = now_.verdict != Verdict::kHealthy && now_.verdict != Verdict::kInhibited;
    if (is_alarm && !outcome.detection_delay_s) outcome.detection_delay_s = delay_s;
    if (now_.verdict == Verdict::kIsolated && now_.sets.front() == outcome.faults &&
        !outcome.isolation_delay_s) {
      outcome.isolation_delay_s = delay_s;
    }
  }
  outcome.last_verdict = verdicts_.size() - 1;
}

void RunHistory::check_expectations() {
  for (ExpectationOutcome& outcome : expectations_) {
    const Expectation& expectation = outcome.expectation;
    if (now_.t_s < expectation.from_s - kTimeSlack_s ||
        now_.t_s > expectation.until_s + kTimeSlack_s) {
      continue;
    }
    ++outcome.samples;
    if (!outcome.first_unmet && !agrees(expectation, now_)) outcome.first_unmet = now_;
  }
}

std::vector<ExpectationOutcome> RunHistory::expectations() const {
  std::vector<ExpectationOutcome> outcomes = expectations_;
  for (ExpectationOutcome& outcome : outcomes) {
    outcome.is_met = outcome.samples > 0 && !outcome.first_unmet;
  }
  return outcomes;
}

bool RunHistory::are_expectations_met() const {
  const std::vector<ExpectationOutcome> outcomes = expectations();
  return std::all_of(outcomes.begin(), outcomes.end(),
                     [](const ExpectationOutcome& outcome) { return outcome.is_met; });
}

std::string verdict_text(const VerdictEntry& entry) {
  std::string text(verdict_name(entry.verdict));
  for (std::size_t i = 0; i < entry.sets.size(); ++i) {
    if (entry.sets[i].empty()) continue;
    text += fmt::format("{}{}", i == 0 ? " " : " | ", fmt::join(entry.sets[i], ", "));
  }
  return text;
}

}  // namespace faultline

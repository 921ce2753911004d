#include "tools/bench/run_history.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace faultline {
namespace {

// Whether `filter` may be silent for `cause` although it sees members of `set`.
bool is_excused(const ResidualFilter& filter, const std::vector<std::size_t>& set, Cause cause) {
  bool is_seen = false;
  bool is_steady = false;
  for (const std::size_t fault : set) {
    is_seen = is_seen || filter.sees[fault] != Sensitivity::kNone;
    is_steady = is_steady || filter.sees[fault] == Sensitivity::kSteady;
  }
  return is_seen && is_steady == (cause == Cause::kCancellation);
}

}  // namespace

double smallest_isolated(const Bank& bank, std::size_t fault) {
  double smallest = 0.0;
  for (const ResidualFilter& filter : bank.filters) {
    const std::vector<double>& fires_from = filter.certificate.smallest_fault;
    if (fault < fires_from.size() && filter.sees[fault] == Sensitivity::kSteady) {
      smallest = std::max(smallest, fires_from[fault]);
    }
  }
  return smallest;
}

bool has_own_signature(const Bank& bank, std::size_t fault) {
  for (std::size_t other = 0; other < bank.fault_names.size(); ++other) {
    const auto looks_like = [&](const ResidualFilter& filter) {
      return filter.sees[other] == filter.sees[fault];
    };
    if (other != fault && std::all_of(bank.filters.begin(), bank.filters.end(), looks_like)) {
      return false;
    }
  }
  return true;
}

RunHistory::RunHistory(const Bank& bank, const std::vector<std::vector<std::size_t>>& fault_sets,
                       const Scenario& scenario, const FaultSchedule& schedule)
    : bank_(&bank),
      fault_sets_(&fault_sets),
      schedule_(&schedule),
      first_fired_s_(bank.filters.size()) {
  for (std::size_t fault = 0; fault < bank.fault_names.size(); ++fault) {
    smallest_isolated_.push_back(smallest_isolated(bank, fault));
  }
  for (const Expectation& expectation : scenario.expectations) {
    expectations_.emplace_back(expectation);
  }
}

VerdictEntry RunHistory::entry_of(const DiagnosisRecord& record, double t_s) const {
  const Decision& decision = record.decision;
  VerdictEntry entry{.t_s = t_s, .verdict = decision.verdict, .cause = decision.cause};
  const std::size_t listed = std::min<std::size_t>(decision.set_count, Decision::kMaxListed);
  for (std::size_t i = 0; i < listed; ++i) {
    std::vector<std::string>& names = entry.sets.emplace_back();
    for (const std::size_t fault : (*fault_sets_)[decision.sets[i]]) {
      names.push_back(bank_->fault_names[fault]);
    }
    std::sort(names.begin(), names.end());
  }
  if (record.onset.cycle != Onset::kNone) {
    entry.onset_s = static_cast<double>(record.onset.cycle) * bank_->sample_time_s;
  }
  entry.note = note_of(record);
  entry.blame = blame_text(record);
  return entry;
}

std::string RunHistory::note_of(const DiagnosisRecord& record) const {
  const Decision& decision = record.decision;
  if (decision.cause == Cause::kMoreThanP) {
    return fmt::format("more than {} fault{}", bank_->concurrent,
                       bank_->concurrent == 1 ? "" : "s");
  }
  if (decision.cause == Cause::kPartial) return "partial signature";
  if (decision.cause != Cause::kCancellation && decision.cause != Cause::kTransient) return "";
  const char* const what = decision.cause == Cause::kTransient      ? "only transients reach"
                           : decision.verdict == Verdict::kIsolated ? "they cancel in"
                                                                    : "some may cancel in";
  std::vector<std::string> silent;
  for (std::size_t i = 0; i < bank_->filters.size(); ++i) {
    const bool is_silent = record.fired[i] == 0;
    const std::size_t listed = std::min<std::size_t>(decision.set_count, Decision::kMaxListed);
    for (std::size_t s = 0; is_silent && s < listed; ++s) {
      if (is_excused(bank_->filters[i], (*fault_sets_)[decision.sets[s]], decision.cause)) {
        silent.push_back(bank_->filters[i].name);
        break;
      }
    }
  }
  return silent.empty() ? "" : fmt::format("{} {}", what, fmt::join(silent, ", "));
}

void RunHistory::on_record(const DiagnosisRecord& record) {
  ++samples_;
  const double t_s = record.cycle * bank_->sample_time_s;
  const bool is_change = !last_decision_ || !is_same_verdict(record.decision, *last_decision_);
  if (is_change) {
    now_ = entry_of(record, t_s);
    verdicts_.push_back(now_);
  } else if (record.decision.cause != last_decision_->cause) {
    verdicts_.back().cause = now_.cause = record.decision.cause;
    verdicts_.back().note = now_.note = note_of(record);
  }
  if (now_.blame.empty() && record.fault != MessageFault::kNone) {
    verdicts_.back().blame = now_.blame = blame_text(record);
  }
  last_decision_ = record.decision;
  now_.t_s = t_s;
  for (std::size_t i = 0; i < record.fired.size(); ++i) {
    if (record.fired[i] != 0 && !first_fired_s_[i]) first_fired_s_[i] = t_s;
  }
  follow_injections(is_change);
  for (ExpectationWatch& expectation : expectations_) expectation.on_sample(record, now_);
}

void RunHistory::on_estimate(const FaultEstimate& estimate) {
  VerdictEntry& entry = verdicts_.back();
  const MagnitudeEstimate& magnitudes = estimate.magnitudes;
  if (magnitudes.status != EstimateStatus::kValid) {
    // The samples of a window that is not full yet do not unsay the last estimate.
    if (entry.estimates.empty()) entry.no_estimate = estimate_status_text(magnitudes.status);
    for (ExpectationWatch& expectation : expectations_) {
      expectation.on_no_estimate(estimate_status_text(magnitudes.status));
    }
    return;
  }
  entry.no_estimate.clear();
  entry.estimates.clear();
  for (std::size_t i = 0; i < magnitudes.faults.size(); ++i) {
    entry.estimates.push_back({bank_->fault_names[magnitudes.faults[i]], magnitudes.value[i],
                               magnitudes.deviation[i], magnitudes.bound[i]});
  }
  std::sort(entry.estimates.begin(), entry.estimates.end(),
            [](const EstimateEntry& a, const EstimateEntry& b) { return a.fault < b.fault; });
  if (estimate.onset_cycle != Onset::kNone) {
    entry.onset_s = static_cast<double>(estimate.onset_cycle) * bank_->sample_time_s;
  }
  for (ExpectationWatch& expectation : expectations_) {
    expectation.on_estimates(now_.t_s, entry.estimates);
  }
}

void RunHistory::follow_injections(bool is_change) {
  active_.resize(schedule_->size());
  for (std::size_t i = 0; i < active_.size(); ++i) {
    active_[i] = schedule_->activity(i, now_.t_s) > 0.0 ? 1 : 0;
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
  find_small_faults(outcome);
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

// Of the biases acting now; a gain fault has no size of its own.
void RunHistory::find_small_faults(InjectionOutcome& outcome) const {
  outcome.small_faults.clear();
  for (std::size_t fault = 0; fault < smallest_isolated_.size(); ++fault) {
    double value = 0.0;
    for (std::size_t i = 0; i < active_.size(); ++i) {
      const Injection& injection = schedule_->injection(i);
      if (active_[i] == 0 || injection.kind != InjectionKind::kBias) continue;
      if (injection.target == bank_->fault_names[fault]) value += schedule_->value(i, now_.t_s);
    }
    if (value != 0.0 && std::abs(value) < smallest_isolated_[fault]) {
      outcome.small_faults.push_back({bank_->fault_names[fault], value, smallest_isolated_[fault]});
    }
  }
}

std::vector<ExpectationOutcome> RunHistory::expectations() const {
  std::vector<ExpectationOutcome> outcomes;
  for (const ExpectationWatch& expectation : expectations_) {
    outcomes.push_back(expectation.outcome());
  }
  return outcomes;
}

bool RunHistory::are_expectations_met() const {
  const std::vector<ExpectationOutcome> outcomes = expectations();
  return std::all_of(outcomes.begin(), outcomes.end(),
                     [](const ExpectationOutcome& outcome) { return outcome.is_met; });
}

}  // namespace faultline

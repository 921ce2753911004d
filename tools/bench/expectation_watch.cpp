#include "tools/bench/expectation_watch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

/// Slack for comparing cycle times with times written in a file: half a nanosecond.
constexpr double kTimeSlack_s = 0.5e-9;

bool is_alarm(Verdict verdict) {
  return verdict != Verdict::kHealthy && verdict != Verdict::kInhibited;
}

/// "found unexplained (partial signature) at 4.3 s".
std::string found_text(const VerdictEntry& now) {
  return fmt::format("found {}{} at {:g} s", verdict_text(now),
                     now.note.empty() ? "" : " (" + now.note + ")", now.t_s);
}

bool is_among(std::string_view name, const std::vector<std::string>& names) {
  return names.empty() || std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace

ExpectationWatch::ExpectationWatch(Expectation expectation)
    : expectation_(std::move(expectation)) {}

bool ExpectationWatch::agrees(const DiagnosisRecord& record, const VerdictEntry& now) const {
  if (!expectation_.allows(now.verdict)) return false;
  if (now.verdict == Verdict::kIsolated) {
    return expectation_.faults.empty() || now.sets.front() == expectation_.faults;
  }
  if (now.verdict != Verdict::kAmbiguous || expectation_.sets.empty()) return true;
  const bool has_right_count =
      expectation_.may_have_more_sets || record.decision.set_count == expectation_.sets.size();
  return has_right_count &&
         std::all_of(expectation_.sets.begin(), expectation_.sets.end(), [&](const auto& set) {
           return std::find(now.sets.begin(), now.sets.end(), set) != now.sets.end();
         });
}

void ExpectationWatch::refuse(const VerdictEntry& now, std::string found) {
  if (!found_.empty()) return;
  first_unmet_ = now;
  found_ = std::move(found);
}

void ExpectationWatch::on_sample(const DiagnosisRecord& record, const VerdictEntry& now) {
  is_inside_ = now.t_s >= expectation_.from_s - kTimeSlack_s &&
               now.t_s <= expectation_.until_s + kTimeSlack_s;
  is_over_ = now.t_s >= expectation_.until_s - kTimeSlack_s;
  if (!is_inside_) return;
  ++samples_;
  if (expectation_.has_no_false_alarm && is_alarm(now.verdict)) {
    refuse(now, "false alarm: " + found_text(now));
  }
  watch_verdict(record, now);
  if (expectation_.has_blame()) watch_blame(record, now);
}

void ExpectationWatch::watch_verdict(const DiagnosisRecord& record, const VerdictEntry& now) {
  const bool is_late = now.t_s > expectation_.deadline_s() + kTimeSlack_s;
  if (is_late && waiting_) {
    refuse(*waiting_, found_text(*waiting_) + ", the deadline");
    waiting_.reset();
  }
  if (agrees(record, now)) {
    waiting_.reset();
    if (!is_late && !agrees_since_s_) agrees_since_s_ = now.t_s;
  } else if (is_late || !expectation_.within_s) {
    refuse(now, found_text(now));
  } else {
    waiting_ = now;
    agrees_since_s_.reset();
  }
}

void ExpectationWatch::watch_blame(const DiagnosisRecord& record, const VerdictEntry& now) {
  const bool has_cause = now.verdict == Verdict::kInhibited && record.fault != MessageFault::kNone;
  if (!has_cause) return;
  if (is_among(record.blamed_message, expectation_.blamed) &&
      is_among(message_fault_name(record.fault), expectation_.blamed_faults)) {
    was_blamed_ = true;
  } else {
    refuse(now, fmt::format("found inhibited ({}) at {:g} s", blame_text(record), now.t_s));
  }
}

void ExpectationWatch::on_estimates(double t_s, const std::vector<EstimateEntry>& estimates) {
  if (!is_inside_ || expectation_.estimates.empty()) return;
  estimates_ = estimates;
  estimated_at_s_ = t_s;
}

void ExpectationWatch::on_no_estimate(std::string_view reason) {
  if (is_inside_ && estimates_.empty()) no_estimate_ = reason;
}

std::string ExpectationWatch::unmet_estimate() const {
  for (const ExpectedEstimate& expected : expectation_.estimates) {
    const auto found =
        std::find_if(estimates_.begin(), estimates_.end(),
                     [&](const EstimateEntry& entry) { return entry.fault == expected.fault; });
    if (found == estimates_.end()) {
      return fmt::format("found no estimate of {}{}", expected.fault,
                         no_estimate_.empty() ? "" : " (" + no_estimate_ + ")");
    }
    if (!(std::abs(found->value - expected.value) <= expected.tolerance)) {
      return fmt::format("found {} = {:.6g} at {:g} s", expected.fault, found->value,
                         estimated_at_s_);
    }
  }
  return "";
}

ExpectationOutcome ExpectationWatch::outcome() const {
  ExpectationOutcome outcome{.expectation = expectation_,
                             .is_final = is_over_ || !found_.empty(),
                             .samples = samples_,
                             .first_unmet = first_unmet_,
                             .found = found_};
  if (samples_ == 0) {
    outcome.found = "the run had no sample there";
  } else if (outcome.found.empty() && waiting_) {
    outcome.first_unmet = waiting_;
    outcome.found = found_text(*waiting_) + ", the last sample there";
  } else if (outcome.found.empty() && expectation_.has_blame() && !was_blamed_) {
    outcome.found = "no message was blamed";
  } else if (outcome.found.empty()) {
    outcome.found = unmet_estimate();
  }
  outcome.is_met = outcome.found.empty();
  if (expectation_.within_s && outcome.is_met && agrees_since_s_) {
    outcome.delay_s = std::max(0.0, *agrees_since_s_ - expectation_.from_s);
  }
  return outcome;
}

}  // namespace faultline

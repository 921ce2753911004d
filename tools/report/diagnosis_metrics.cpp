#include "tools/report/diagnosis_metrics.h"

#include <algorithm>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "sim/fault.h"

namespace faultline {
namespace {

std::optional<double> ratio(double part, std::int64_t whole) noexcept {
  if (whole == 0) return std::nullopt;
  return part / static_cast<double>(whole);
}

/// s(k) of a verdict while `faults` act.
double isolation_score(const VerdictStretch& verdict, const std::vector<std::string>& faults) {
  const bool is_among =
      std::find(verdict.sets.begin(), verdict.sets.end(), faults) != verdict.sets.end();
  if (!is_among) return 0.0;
  if (verdict.verdict == "isolated") return 1.0;
  if (verdict.verdict != "ambiguous") return 0.0;
  const auto sets = std::max(verdict.set_total, static_cast<std::int64_t>(verdict.sets.size()));
  return 1.0 / static_cast<double>(sets);
}

std::string truth_words(const std::vector<std::string>& faults) {
  return faults.empty() ? "none" : fmt::format("{}", fmt::join(faults, ", "));
}

// Ambiguous and unexplained ones are one column each: their sets would be as many as the cycles.
std::string confusion_column(const VerdictStretch& verdict) {
  return verdict.verdict == "isolated" ? verdict_words(verdict) : verdict.verdict;
}

bool is_same_verdict(const VerdictStretch& a, const VerdictStretch& b) {
  return a.verdict == b.verdict && a.sets == b.sets;
}

void count_overlap(DiagnosisMetrics& metrics, const TruthStretch& truth,
                   const VerdictStretch& verdict, bool began_in_fault) {
  const std::int64_t from = std::max(truth.cycles.from, verdict.cycles.from);
  const std::int64_t cycles = std::min(truth.cycles.until, verdict.cycles.until) - from;
  if (cycles <= 0) return;
  metrics.confusion[truth_words(truth.faults)][confusion_column(verdict)] += cycles;
  const bool is_inhibited = verdict.verdict == "inhibited";
  if (is_inhibited) metrics.inhibited_cycles += cycles;
  if (truth.faults.empty()) {
    if (!is_inhibited) metrics.faultless_cycles += cycles;
    if (!verdict.is_alarm()) return;
    metrics.false_alarm_cycles += cycles;
    if (began_in_fault) metrics.clearing_cycles += cycles;
    return;
  }
  metrics.faulty_cycles += cycles;
  if (!verdict.is_alarm()) return;
  metrics.detected_cycles += cycles;
  metrics.isolation_score += static_cast<double>(cycles) * isolation_score(verdict, truth.faults);
}

FaultOutcome outcome_of(const TruthStretch& truth, const std::vector<VerdictStretch>& verdicts) {
  FaultOutcome outcome;
  outcome.truth = truth;
  // The first verdict that reaches into the stretch; those before it end at its beginning.
  auto verdict = std::partition_point(
      verdicts.begin(), verdicts.end(),
      [&](const VerdictStretch& v) { return v.cycles.until <= truth.cycles.from; });
  for (; verdict != verdicts.end() && verdict->cycles.from < truth.cycles.until; ++verdict) {
    if (!verdict->is_alarm()) continue;
    outcome.is_detected = true;
    const bool is_news = verdict->cycles.from >= truth.cycles.from &&
                         (verdict == verdicts.begin() || !is_same_verdict(*verdict, verdict[-1]));
    if (!is_news) continue;
    const std::int64_t delay = verdict->cycles.from - truth.cycles.from;
    if (!outcome.detection_delay) outcome.detection_delay = delay;
    const bool is_exact = verdict->verdict == "isolated" && !verdict->sets.empty() &&
                          verdict->sets.front() == truth.faults;
    if (is_exact && !outcome.isolation_delay) outcome.isolation_delay = delay;
  }
  return outcome;
}

}  // namespace

std::optional<double> DiagnosisMetrics::true_detection_rate() const noexcept {
  return ratio(static_cast<double>(detected_cycles), faulty_cycles);
}

std::optional<double> DiagnosisMetrics::missed_detection_rate() const noexcept {
  return ratio(static_cast<double>(faulty_cycles - detected_cycles), faulty_cycles);
}

std::optional<double> DiagnosisMetrics::false_alarm_rate() const noexcept {
  return ratio(static_cast<double>(false_alarm_cycles), faultless_cycles);
}

std::optional<double> DiagnosisMetrics::fault_isolation_accuracy() const noexcept {
  return ratio(isolation_score, detected_cycles);
}

std::vector<TruthStretch> truth_stretches(const std::vector<RecordedFault>& faults,
                                          CycleRange cycles) {
  // What begins and ends where, in order of cycles.
  struct Edge {
    std::int64_t cycle;
    bool is_begin;
    const std::string* target;
  };
  std::vector<Edge> edges;
  for (const RecordedFault& fault : faults) {
    const auto kind = find_injection_kind(fault.kind);
    if (kind && level_of(*kind) == FaultLevel::kFrame) continue;
    const std::int64_t from = std::max(fault.from_cycle, cycles.from);
    const std::int64_t until = std::min(fault.until_cycle.value_or(cycles.until), cycles.until);
    if (from >= until) continue;
    edges.push_back({from, true, &fault.target});
    edges.push_back({until, false, &fault.target});
  }
  std::stable_sort(edges.begin(), edges.end(),
                   [](const Edge& a, const Edge& b) { return a.cycle < b.cycle; });
  std::vector<TruthStretch> stretches;
  std::multiset<std::string> acting;  // a target may have several faults at once
  std::int64_t from = cycles.from;
  const auto close = [&](std::int64_t until) {
    if (until <= from) return;
    std::vector<std::string> names(acting.begin(), acting.end());
    names.erase(std::unique(names.begin(), names.end()), names.end());
    if (!stretches.empty() && stretches.back().faults == names) {
      stretches.back().cycles.until = until;
    } else {
      stretches.push_back({{from, until}, std::move(names)});
    }
    from = until;
  };
  for (const Edge& edge : edges) {
    close(edge.cycle);
    if (edge.is_begin) {
      acting.insert(*edge.target);
    } else {
      acting.erase(acting.find(*edge.target));
    }
  }
  close(cycles.until);
  return stretches;
}

DiagnosisMetrics diagnosis_metrics(const std::vector<TruthStretch>& truth,
                                   const std::vector<VerdictStretch>& verdicts) {
  DiagnosisMetrics metrics;
  std::size_t t = 0, v = 0;
  bool began_in_fault = false;  // the alarm that stands, whatever it has turned into since
  bool was_alarm = false;
  std::size_t seen = verdicts.size();
  while (t < truth.size() && v < verdicts.size()) {
    const TruthStretch& now = truth[t];
    const VerdictStretch& verdict = verdicts[v];
    const std::int64_t from = std::max(now.cycles.from, verdict.cycles.from);
    const bool do_meet = from < std::min(now.cycles.until, verdict.cycles.until);
    if (do_meet && seen != v) {  // the verdict begins here
      seen = v;
      if (verdict.is_alarm() && !was_alarm) {
        began_in_fault = !now.faults.empty();
        if (!began_in_fault) ++metrics.false_alarms;
      }
      was_alarm = verdict.is_alarm();
    }
    if (do_meet && !now.faults.empty() && verdict.is_alarm()) began_in_fault = true;
    count_overlap(metrics, now, verdict, began_in_fault);
    if (now.cycles.until <= verdict.cycles.until) {
      ++t;
    } else {
      ++v;
    }
  }
  for (const TruthStretch& stretch : truth) {
    if (stretch.faults.empty()) continue;
    metrics.outcomes.push_back(outcome_of(stretch, verdicts));
    if (!metrics.outcomes.back().is_detected) ++metrics.missed_faults;
  }
  return metrics;
}

std::string verdict_words(const VerdictStretch& stretch) {
  if (stretch.verdict != "isolated" && stretch.verdict != "ambiguous") return stretch.verdict;
  std::vector<std::string> sets;
  for (const auto& set : stretch.sets) sets.push_back(fmt::format("{}", fmt::join(set, ", ")));
  return fmt::format("{} {}", stretch.verdict, fmt::join(sets, " | "));
}

}  // namespace faultline

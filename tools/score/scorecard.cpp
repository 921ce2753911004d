#include "tools/score/scorecard.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/model/input_error.h"

namespace faultline {
namespace {

template <class Value>
std::optional<Value> cell(const CampaignRow& row, std::string_view column) {
  const Cell& found = row.at(column_index(column));
  if (const auto* value = std::get_if<Value>(&found)) return *value;
  if constexpr (std::is_same_v<Value, double>) {  // SQLite stores whole numbers shorter
    if (const auto* whole = std::get_if<std::int64_t>(&found)) return static_cast<double>(*whole);
  }
  return std::nullopt;
}

double number(const CampaignRow& row, std::string_view column) {
  return cell<double>(row, column).value_or(0.0);
}

std::vector<std::optional<double>> peaks(const CampaignRow& row, std::string_view column) {
  const auto json =
      nlohmann::json::parse(cell<std::string>(row, column).value_or("[]"), nullptr, false);
  std::vector<std::optional<double>> result;
  if (!json.is_array()) return result;
  for (const auto& value : json) {
    result.push_back(value.is_number() ? std::optional(value.get<double>()) : std::nullopt);
  }
  return result;
}

ScoredRun scored(const CampaignRow& row) {
  ScoredRun run;
  run.run = static_cast<std::uint64_t>(cell<std::int64_t>(row, "run").value_or(0));
  run.seed = cell<std::int64_t>(row, "seed").value_or(0);
  run.point = cell<std::string>(row, "point").value_or("");
  run.truth = cell<std::string>(row, "truth").value_or("none");
  run.kind = cell<std::string>(row, "kind").value_or("");
  run.verdict = cell<std::string>(row, "verdict").value_or("");
  if (const auto size = cell<double>(row, "size"); size && *size != 0.0) run.size = std::abs(*size);
  run.detection_delay_s = cell<double>(row, "detection_delay_s");
  run.isolation_delay_s = cell<double>(row, "isolation_delay_s");
  run.is_detected = number(row, "detected_cycles") > 0.0;
  run.peak_faultless = peaks(row, "peak_faultless");
  run.peak_faulty = peaks(row, "peak_faulty");
  return run;
}

/// Sums over runs, run by run.
struct Sums {
  std::vector<double> faulty, detected, missed, score, faultless, false_alarm;

  void add(const CampaignRow& row) {
    faulty.push_back(number(row, "faulty_cycles"));
    detected.push_back(number(row, "detected_cycles"));
    missed.push_back(faulty.back() - detected.back());
    score.push_back(number(row, "isolation_score"));
    faultless.push_back(number(row, "faultless_cycles"));
    false_alarm.push_back(number(row, "false_alarm_cycles"));
  }
};

/// Of n runs: those that are not among the delays come later than all others.
std::optional<Estimate> delay(const std::vector<double>& sorted, std::uint64_t n, double q) {
  auto estimate = quantile(sorted, n - sorted.size(), q);
  if (estimate) estimate->low = std::max(estimate->low, 0.0);
  return estimate;
}

FaultScore fault_score(const std::string& truth, const std::string& kind,
                       const std::vector<const ScoredRun*>& runs, const Scorecard& card) {
  FaultScore score{.truth = truth, .kind = kind, .runs = runs.size()};
  std::vector<double> detection, isolation;
  std::uint64_t detected = 0;
  for (const ScoredRun* run : runs) {
    detected += run->is_detected ? 1U : 0U;
    if (run->detection_delay_s) detection.push_back(*run->detection_delay_s);
    if (run->isolation_delay_s) isolation.push_back(*run->isolation_delay_s);
    if (run->size) score.trials.push_back({*run->size, run->is_detected});
  }
  std::sort(detection.begin(), detection.end());
  std::sort(isolation.begin(), isolation.end());
  const std::uint64_t n = runs.size();
  score.detected = proportion(detected, n);
  score.isolated = proportion(isolation.size(), n);
  score.detection_median_s = delay(detection, n, 0.5);
  score.detection_p95_s = delay(detection, n, 0.95);
  score.isolation_median_s = delay(isolation, n, 0.5);
  score.isolation_p95_s = delay(isolation, n, 0.95);
  score.detectable = detectable_size(score.trials);
  const auto predicted = card.campaign.smallest_faults.find(truth);
  if (kind == "bias" && predicted != card.campaign.smallest_faults.end()) {
    score.predicted = predicted->second;
  }
  return score;
}

void score_faults(Scorecard& card) {
  std::map<std::pair<std::string, std::string>, std::vector<const ScoredRun*>> groups;
  for (const ScoredRun& run : card.all) {
    ++card.confusion[run.truth][run.verdict];
    if (run.has_fault()) groups[{run.truth, run.kind}].push_back(&run);
  }
  for (const auto& [key, runs] : groups) {
    card.faults.push_back(fault_score(key.first, key.second, runs, card));
  }
}

void score_residuals(Scorecard& card) {
  for (std::size_t i = 0; i < card.campaign.residuals.size(); ++i) {
    std::vector<double> without, with;
    for (const ScoredRun& run : card.all) {
      if (i < run.peak_faultless.size() && run.peak_faultless[i]) {
        without.push_back(*run.peak_faultless[i]);
      }
      if (run.has_fault() && i < run.peak_faulty.size() && run.peak_faulty[i]) {
        with.push_back(*run.peak_faulty[i]);
      }
    }
    card.residuals.push_back({card.campaign.residuals[i], area_under_roc(without, with)});
  }
}

std::optional<double> largest(const std::vector<std::optional<double>>& peaks) {
  std::optional<double> result;
  for (const auto& peak : peaks) {
    if (peak && (!result || *peak > *result)) result = peak;
  }
  return result;
}

double share_above(const std::vector<double>& sorted, double scale) {
  const auto above = sorted.end() - std::upper_bound(sorted.begin(), sorted.end(), scale);
  return sorted.empty() ? 0.0 : static_cast<double>(above) / static_cast<double>(sorted.size());
}

void score_roc(Scorecard& card) {
  std::vector<double> without, with;
  for (const ScoredRun& run : card.all) {
    if (const auto peak = largest(run.peak_faultless)) without.push_back(*peak);
    if (const auto peak = largest(run.peak_faulty); peak && run.has_fault()) with.push_back(*peak);
  }
  if (without.empty() || with.empty()) return;
  std::sort(without.begin(), without.end());
  std::sort(with.begin(), with.end());
  std::vector<double> scales = without;
  scales.insert(scales.end(), with.begin(), with.end());
  std::sort(scales.begin(), scales.end());
  constexpr std::size_t kPoints = 200;
  const std::size_t step = std::max<std::size_t>(1, scales.size() / kPoints);
  card.roc.push_back({0.0, 1.0, 1.0});
  for (std::size_t i = 0; i < scales.size(); i += step) {
    card.roc.push_back({scales[i], share_above(without, scales[i]), share_above(with, scales[i])});
  }
  card.roc.push_back({std::numeric_limits<double>::infinity(), 0.0, 0.0});
}

/// (b - c) / n with b, c the discordant pairs of n (Wald).
Estimate paired_difference(std::uint64_t only_a, std::uint64_t only_b, std::uint64_t n) {
  const auto a = static_cast<double>(only_a), b = static_cast<double>(only_b);
  const auto pairs = static_cast<double>(n);
  const double value = (b - a) / pairs;
  const double half =
      1.959964 * std::sqrt(std::max(0.0, a + b - (b - a) * (b - a) / pairs)) / pairs;
  return {value, std::max(-1.0, value - half), std::min(1.0, value + half)};
}

}  // namespace

Scorecard scorecard_of(const CampaignDatabase& database) {
  Scorecard card;
  card.campaign = database.identity();
  const CampaignTally tally = database.tally();
  card.runs = tally.runs;
  card.failed = tally.failed;
  card.faulty = tally.faulty;
  card.false_alarms = tally.false_alarms;
  card.faultless_h = tally.faultless_h;
  if (card.faultless_h > 0.0) {
    card.false_alarms_per_h = event_rate(card.false_alarms, card.faultless_h);
  }
  Sums sums;
  constexpr std::uint64_t kBatch = 4096;
  for (std::uint64_t from = 0;;) {
    const std::vector<CampaignRow> rows = database.rows(from, kBatch);
    for (const CampaignRow& row : rows) {
      if (cell<std::string>(row, "error")) continue;
      sums.add(row);
      card.all.push_back(scored(row));
    }
    if (rows.size() < kBatch) break;
    from = static_cast<std::uint64_t>(cell<std::int64_t>(rows.back(), "run").value_or(0)) + 1;
  }
  card.TDR = clustered_ratio(sums.detected, sums.faulty);
  card.missed_detection_rate = clustered_ratio(sums.missed, sums.faulty);
  card.FAR = clustered_ratio(sums.false_alarm, sums.faultless);
  card.FIA = clustered_ratio(sums.score, sums.detected);
  score_faults(card);
  score_residuals(card);
  score_roc(card);
  return card;
}

Comparison compare(const Scorecard& a, const Scorecard& b) {
  Comparison result;
  std::unordered_map<std::uint64_t, const ScoredRun*> of_b;
  for (const ScoredRun& run : b.all) of_b.emplace(run.run, &run);
  std::vector<double> delays;
  for (const ScoredRun& one : a.all) {
    const auto found = of_b.find(one.run);
    if (found == of_b.end()) continue;
    const ScoredRun& other = *found->second;
    if (one.seed != other.seed || one.point != other.point || one.truth != other.truth) continue;
    ++result.pairs;
    if (!one.has_fault()) continue;
    ++result.faulty;
    result.only_a_detects += one.is_detected && !other.is_detected ? 1U : 0U;
    result.only_b_detects += !one.is_detected && other.is_detected ? 1U : 0U;
    const bool isolates = one.isolation_delay_s.has_value();
    const bool other_isolates = other.isolation_delay_s.has_value();
    result.only_a_isolates += isolates && !other_isolates ? 1U : 0U;
    result.only_b_isolates += !isolates && other_isolates ? 1U : 0U;
    if (one.detection_delay_s && other.detection_delay_s) {
      delays.push_back(*other.detection_delay_s - *one.detection_delay_s);
    }
  }
  if (result.faulty > 0) {
    result.detected_difference =
        paired_difference(result.only_a_detects, result.only_b_detects, result.faulty);
    result.isolated_difference =
        paired_difference(result.only_a_isolates, result.only_b_isolates, result.faulty);
  }
  std::sort(delays.begin(), delays.end());
  if (!delays.empty()) {
    result.delay_difference_s = quantile(delays, 0, 0.5);
  }
  return result;
}

}  // namespace faultline

#include "tools/campaign/campaign_run.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "diagnosis/model/input_error.h"
#include "tools/bench/bench.h"
#include "tools/report/diagnosis_metrics.h"

namespace faultline {
namespace {

constexpr double kNone = -1.0;

/// Per residual, the largest value over time of the smallest ratio of evaluation to threshold of
/// `dwell` samples in a row: it fires if and only if this is above 1, and would with a threshold x
/// times as large if it is above x. Samples of an inhibited diagnosis begin the row again.
class HeldPeaks {
 public:
  explicit HeldPeaks(const Bank& bank)
      : dwell_(std::max<std::size_t>(bank.decision.dwell, 1)),
        count_(bank.filters.size()),
        ratios_(dwell_ * count_),
        before_(count_, kNone),
        after_(count_, kNone) {}

  void take(const DiagnosisRecord& record, bool is_after) {
    if (is_after != is_after_) held_ = 0;
    is_after_ = is_after;
    if (record.decision.verdict == Verdict::kInhibited) {
      held_ = 0;
      return;
    }
    double* const newest = &ratios_[(held_ % dwell_) * count_];
    for (std::size_t i = 0; i < count_; ++i) {
      const double ratio = record.evaluation[i] / record.thresholds[i];
      newest[i] = std::isfinite(ratio) ? ratio : std::numeric_limits<double>::max();
    }
    if (++held_ < dwell_) return;
    std::vector<double>& peaks = is_after ? after_ : before_;
    for (std::size_t i = 0; i < count_; ++i) {
      double smallest = newest[i];
      for (std::size_t n = 0; n < dwell_; ++n) {
        smallest = std::min(smallest, ratios_[n * count_ + i]);
      }
      peaks[i] = std::max(peaks[i], smallest);
    }
  }

  [[nodiscard]] static std::string text(const std::vector<double>& peaks) {
    nlohmann::json json = nlohmann::json::array();
    for (const double peak : peaks) {
      json.push_back(peak == kNone ? nlohmann::json() : nlohmann::json(peak));
    }
    return json.dump();
  }
  [[nodiscard]] const std::vector<double>& before() const noexcept { return before_; }
  [[nodiscard]] const std::vector<double>& after() const noexcept { return after_; }

 private:
  std::size_t dwell_, count_;
  std::vector<double> ratios_;  // of the last `dwell` samples
  std::size_t held_ = 0;        // samples in a row
  bool is_after_ = false;
  std::vector<double> before_, after_;
};

/// When the faults of the plant act, cycle by cycle, as TRUTH would tell it.
std::vector<RecordedFault> acting_faults(const BenchInputs& inputs, std::int64_t cycles) {
  std::vector<RecordedFault> faults;
  const FaultSchedule& schedule = inputs.schedule;
  for (std::size_t i = 0; i < schedule.size(); ++i) {
    const Injection& injection = schedule.injection(i);
    if (level_of(injection.kind) == FaultLevel::kFrame) continue;
    bool is_acting = false;
    for (std::int64_t k = 0; k < cycles; ++k) {
      const double t_s = static_cast<double>(k) * inputs.bank.sample_time_s;
      const bool acts = schedule.activity(i, t_s) > 0.0;
      if (acts && !is_acting) {
        faults.push_back({injection.target, std::string(injection_kind_name(injection.kind)),
                          injection.value.value_or(std::nan("")), k, std::nullopt});
      } else if (!acts && is_acting) {
        faults.back().until_cycle = k;
      }
      is_acting = acts;
    }
  }
  std::stable_sort(
      faults.begin(), faults.end(),
      [](const RecordedFault& a, const RecordedFault& b) { return a.from_cycle < b.from_cycle; });
  return faults;
}

std::vector<VerdictStretch> verdict_stretches(const RunHistory& history, double sample_time_s,
                                              std::int64_t cycles) {
  std::vector<VerdictStretch> stretches;
  for (const VerdictEntry& entry : history.verdicts()) {
    const std::int64_t from = std::llround(entry.t_s / sample_time_s);
    if (!stretches.empty()) stretches.back().cycles.until = from;
    VerdictStretch& stretch = stretches.emplace_back();
    stretch.cycles = {from, cycles};
    stretch.verdict = verdict_name(entry.verdict);
    stretch.sets = entry.sets;
    stretch.set_total = static_cast<std::int64_t>(entry.sets.size());
  }
  return stretches;
}

/// The verdict in the last cycle before `until`.
std::string verdict_before(const std::vector<VerdictStretch>& verdicts, std::int64_t until) {
  for (const VerdictStretch& verdict : verdicts) {
    if (verdict.cycles.from < until && verdict.cycles.until >= until) return verdict_words(verdict);
  }
  return "";
}

class RowMaker {
 public:
  RowMaker() : row_(kRunColumns.size()) {}
  template <class Value>
  void set(std::string_view column, Value&& value) {
    row_.at(column_index(column)) = std::forward<Value>(value);
  }
  CampaignRow take() { return std::move(row_); }

 private:
  CampaignRow row_;
};

void judge(const BenchInputs& inputs, const BenchResult& result, RowMaker& row) {
  const double sample_time_s = inputs.bank.sample_time_s;
  const auto cycles = static_cast<std::int64_t>(result.counters.cycles);
  const std::vector<RecordedFault> faults = acting_faults(inputs, cycles);
  const std::vector<TruthStretch> truth = truth_stretches(faults, {0, cycles});
  const auto verdicts = verdict_stretches(result.history, sample_time_s, cycles);
  const DiagnosisMetrics metrics = diagnosis_metrics(truth, verdicts);
  row.set("faulty_cycles", metrics.faulty_cycles);
  row.set("detected_cycles", metrics.detected_cycles);
  row.set("faultless_cycles", metrics.faultless_cycles);
  row.set("false_alarm_cycles", metrics.false_alarm_cycles);
  row.set("clearing_cycles", metrics.clearing_cycles);
  row.set("inhibited_cycles", metrics.inhibited_cycles);
  row.set("false_alarms", static_cast<std::int64_t>(metrics.false_alarms));
  row.set("isolation_score", metrics.isolation_score);
  if (!inputs.scenario.expectations.empty()) {
    row.set("expectations_met", std::int64_t{result.history.are_expectations_met() ? 1 : 0});
  }
  if (metrics.outcomes.empty()) {
    row.set("truth", std::string("none"));
    row.set("verdict", verdict_before(verdicts, cycles));
    return;
  }
  const FaultOutcome& outcome = metrics.outcomes.front();
  row.set("truth", fmt::format("{}", fmt::join(outcome.truth.faults, ", ")));
  row.set("verdict", verdict_before(verdicts, outcome.truth.cycles.until));
  row.set("onset_s", static_cast<double>(outcome.truth.cycles.from) * sample_time_s);
  const auto delay = [&](const char* column, const std::optional<std::int64_t>& delay_cycles) {
    if (delay_cycles) row.set(column, static_cast<double>(*delay_cycles) * sample_time_s);
  };
  delay("detection_delay_s", outcome.detection_delay);
  delay("isolation_delay_s", outcome.isolation_delay);
  row.set("kind", faults.front().kind);
  if (std::isfinite(faults.front().value)) row.set("size", faults.front().value);
}

/// The first cycle in which a fault of the plant acts; past all cycles if none does.
std::int64_t first_faulty_cycle(const BenchInputs& inputs) {
  double first_s = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < inputs.schedule.size(); ++i) {
    if (level_of(inputs.schedule.injection(i).kind) == FaultLevel::kFrame) continue;
    first_s = std::min(first_s, inputs.schedule.onset_s(i));
  }
  if (!std::isfinite(first_s)) return std::numeric_limits<std::int64_t>::max();
  return static_cast<std::int64_t>(std::ceil(first_s / inputs.bank.sample_time_s - 1e-9));
}

}  // namespace

CampaignRow run_point(const CampaignInputs& campaign, std::uint64_t run) {
  const SweepPoint point = campaign.sweep().point(run);
  RowMaker row;
  row.set("run", static_cast<std::int64_t>(run));
  row.set("seed", point.seed);
  row.set("point", campaign.sweep().point_json(point));
  try {
    const BenchInputs inputs = campaign.inputs(point);
    row.set("seed", inputs.scenario.seed);
    HeldPeaks peaks(inputs.bank);
    const std::int64_t first_faulty = first_faulty_cycle(inputs);
    BenchOptions options;
    options.bus = "loop";
    options.handles_signals = false;
    options.has_estimates =
        std::any_of(inputs.scenario.expectations.begin(), inputs.scenario.expectations.end(),
                    [](const Expectation& expectation) { return !expectation.estimates.empty(); });
    options.on_record = [&](const DiagnosisRecord& record) {
      peaks.take(record, std::int64_t{record.cycle} >= first_faulty);
    };
    const BenchResult result = run_bench(inputs, options);
    if (result.stop_reason) {
      row.set("error", result.stop_reason->text);
      return row.take();
    }
    judge(inputs, result, row);
    row.set("peak_faultless", HeldPeaks::text(peaks.before()));
    row.set("peak_faulty", HeldPeaks::text(peaks.after()));
  } catch (const std::exception& error) {
    row.set("error", std::string(error.what()));
  }
  return row.take();
}

}  // namespace faultline

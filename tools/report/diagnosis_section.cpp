#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/report/html_table.h"
#include "tools/report/html_text.h"
#include "tools/report/page_sections.h"
#include "tools/report/timeline_svg.h"

namespace faultline {
namespace {

std::string per_cent(const std::optional<double>& rate) {
  return rate ? fmt::format("{:.4g} %", 100.0 * *rate) : std::string("–");
}

std::string delay_text(const ReportedRun& run, const std::optional<std::int64_t>& cycles) {
  return cycles ? fmt::format("{:.4g} s", run.record.time_s(*cycles)) : std::string("–");
}

std::string value_text(double value) {
  return std::isnan(value) ? std::string() : fmt::format(" {:.4g}", value);
}

/// What the fault was, with its value where that is one: a sinusoid's is that of its last moment.
std::string fault_words(const RecordedFault& fault) {
  const std::string value = fault.kind == "sinusoid" ? std::string() : value_text(fault.value);
  return fmt::format("{} {}{}", fault.target, fault.kind, value);
}

/// A lane per target and kind of faults, in the order of their first.
std::vector<TimelineLane> truth_lanes(const ReportedRun& run, CycleRange cycles) {
  constexpr std::size_t kMostLanes = 24;
  std::vector<TimelineLane> lanes;
  for (const RecordedFault& fault : run.record.faults) {
    const std::string name = fmt::format("Truth: {} {}", fault.target, fault.kind);
    auto lane = std::find_if(lanes.begin(), lanes.end(),
                             [&](const TimelineLane& known) { return known.name == name; });
    if (lane == lanes.end()) {
      if (lanes.size() == kMostLanes) continue;
      lane = lanes.insert(lane, {name, {}});
    }
    const std::int64_t from = std::max(fault.from_cycle, cycles.from);
    const std::int64_t until = std::min(fault.until_cycle.value_or(cycles.until), cycles.until);
    if (from >= until) continue;
    lane->bars.push_back({{from, until}, fault_words(fault), "truth"});
  }
  return lanes;
}

std::string timeline_of(const ReportedRun& run) {
  const RunRecord& record = run.record;
  if (!record.cycles) return "<p>The log holds no samples, so there is no timeline.</p>\n";
  const CycleRange cycles = *record.cycles;
  std::vector<TimelineLane> lanes;
  if (record.has_truth) lanes = truth_lanes(run, cycles);
  if (record.has_truth && lanes.empty()) lanes.push_back({"Truth: no fault", {}});
  TimelineLane announced{record.has_truth ? "Verdict" : "Verdict (no truth in the log)", {}};
  const std::set<std::string> known{"healthy", "isolated", "ambiguous", "unexplained", "inhibited"};
  for (const VerdictStretch& stretch : record.verdicts) {
    const CycleRange shown{std::max(stretch.cycles.from, cycles.from),
                           std::min(stretch.cycles.until, cycles.until)};
    if (shown.from >= shown.until) continue;
    announced.bars.push_back({shown, verdict_words(stretch),
                              known.count(stretch.verdict) > 0 ? stretch.verdict : "changing"});
  }
  lanes.push_back(std::move(announced));
  return timeline_svg(lanes, cycles, record.sample_time_s,
                      fmt::format("Timeline{}: {} faults as injected above, {} stretches of "
                                  "verdicts below; both are in the tables that follow.",
                                  run.of_run(), record.faults.size(), record.verdicts.size()));
}

}  // namespace

std::string run_timeline(const ReportedRun& run) { return timeline_of(run); }

namespace {

std::string estimate_text(const VerdictStretch& stretch) {
  std::vector<std::string> texts;
  const estimate_t& estimate = stretch.estimate;
  for (std::size_t i = 0; i < estimate.fault.size(); ++i) {
    std::string text = fmt::format("{} = {:.4g}", estimate.fault[i], estimate.estimate[i]);
    if (estimate.bound[i] >= 0.0) {
      text += fmt::format(", within {:.2g} (proved)", estimate.bound[i]);
    } else if (estimate.deviation[i] >= 0.0) {
      text += fmt::format(" ± {:.2g}", estimate.deviation[i]);
    }
    texts.push_back(std::move(text));
  }
  return fmt::format("{}", fmt::join(texts, "; "));
}

std::string verdict_table(const ReportedRun& run) {
  const RunRecord& record = run.record;
  HtmlTable table(
      "Verdicts as announced" + run.of_run(),
      {{"from", true}, {"to", true}, {"verdict"}, {"cause"}, {"onset", true}, {"estimates"}});
  for (const VerdictStretch& stretch : record.verdicts) {
    table.add(
        {fmt::format("{:.6g} s", record.time_s(stretch.cycles.from)),
         fmt::format("{:.6g} s", record.time_s(stretch.cycles.until)), verdict_words(stretch),
         stretch.blame.empty() ? (stretch.cause == "none" ? "" : stretch.cause) : stretch.blame,
         stretch.onset_cycle >= 0 ? fmt::format("{:.6g} s", record.time_s(stretch.onset_cycle))
                                  : "",
         estimate_text(stretch)});
  }
  return table.is_empty() ? "<p>No verdict is in the log.</p>\n" : table.text();
}

std::string injected_table(const ReportedRun& run) {
  const RunRecord& record = run.record;
  if (!record.has_truth) {
    return "<p>The log has no TRUTH: a real unit does not know its faults.</p>\n";
  }
  HtmlTable table("Faults as injected" + run.of_run(),
                  {{"target"}, {"kind"}, {"value", true}, {"from", true}, {"to", true}});
  for (const RecordedFault& fault : record.faults) {
    table.add({fault.target, fault.kind,
               fault.kind == "sinusoid" ? std::string() : value_text(fault.value),
               fmt::format("{:.6g} s", record.time_s(fault.from_cycle)),
               fault.until_cycle ? fmt::format("{:.6g} s", record.time_s(*fault.until_cycle))
                                 : "the end"});
  }
  return table.is_empty() ? "<p>No fault was injected.</p>\n" : table.text();
}

using MetricText = std::string (*)(const ReportedRun&);
struct MetricRow {
  const char* name;
  const char* meaning;
  MetricText text;
};

const MetricRow kMetricRows[] = {
    {"True detection rate (TDR)", "share of the cycles with a fault in which there is an alarm",
     [](const ReportedRun& run) { return per_cent(run.metrics.true_detection_rate()); }},
    {"Missed-detection rate (MDR)", "1 - TDR; inhibited cycles count as missed",
     [](const ReportedRun& run) { return per_cent(run.metrics.missed_detection_rate()); }},
    {"False-alarm rate (FAR)", "share of the cycles without a fault in which there is an alarm",
     [](const ReportedRun& run) { return per_cent(run.metrics.false_alarm_rate()); }},
    {"Fault isolation accuracy (FIA)",
     "share of the detected cycles with the right fault set: 1 if isolated, 1/n if among n",
     [](const ReportedRun& run) { return per_cent(run.metrics.fault_isolation_accuracy()); }},
    {"False alarms", "that began while no fault acted",
     [](const ReportedRun& run) { return fmt::format("{}", run.metrics.false_alarms); }},
    {"Alarms after a fault's end", "time in which an alarm outlasted its fault; counted in FAR",
     [](const ReportedRun& run) {
       return fmt::format("{:.4g} s", run.record.time_s(run.metrics.clearing_cycles));
     }},
    {"Missed detections", "stretches with a fault and no alarm at all",
     [](const ReportedRun& run) {
       return fmt::format("{} of {}", run.metrics.missed_faults, run.metrics.outcomes.size());
     }},
    {"Inhibited", "time without a statement: start-up, bad samples",
     [](const ReportedRun& run) {
       return fmt::format("{:.4g} s", run.record.time_s(run.metrics.inhibited_cycles));
     }},
};

std::string outcome_table(const ReportedRun& run) {
  HtmlTable table("Delays" + run.of_run(), {{"fault set"},
                                            {"from", true},
                                            {"to", true},
                                            {"detection delay", true},
                                            {"isolation delay", true},
                                            {"detected"}});
  for (const FaultOutcome& outcome : run.metrics.outcomes) {
    table.add({fmt::format("{}", fmt::join(outcome.truth.faults, ", ")),
               fmt::format("{:.6g} s", run.record.time_s(outcome.truth.cycles.from)),
               fmt::format("{:.6g} s", run.record.time_s(outcome.truth.cycles.until)),
               delay_text(run, outcome.detection_delay), delay_text(run, outcome.isolation_delay),
               outcome.is_detected ? "yes" : "MISSED"});
  }
  return table.is_empty() ? std::string() : table.text();
}

std::string confusion_table(const ReportedRun& run) {
  std::set<std::string> verdicts;
  for (const auto& [truth, row] : run.metrics.confusion) {
    for (const auto& [verdict, cycles] : row) verdicts.insert(verdict);
  }
  std::vector<HtmlTable::Column> columns{{"truth \\ verdict"}};
  for (const std::string& verdict : verdicts) columns.push_back({verdict, true});
  HtmlTable table("Isolation confusion" + run.of_run() + ": cycles by truth and verdict", columns);
  for (const auto& [truth, row] : run.metrics.confusion) {
    std::vector<std::string> cells{truth};
    for (const std::string& verdict : verdicts) {
      const auto found = row.find(verdict);
      cells.push_back(found == row.end() ? "" : fmt::format("{}", found->second));
    }
    table.add(cells);
  }
  return table.is_empty() ? std::string() : table.text();
}

}  // namespace

std::string timeline_section(const std::vector<ReportedRun>& runs) {
  std::string page =
      "<section id=\"timeline\" aria-labelledby=\"timeline-h\"><h2 id=\"timeline-h\">Verdict "
      "against truth</h2>\n";
  for (const ReportedRun& run : runs) {
    if (!run.label.empty()) page += fmt::format("<h3>Run {}</h3>\n", run.label);
    page += timeline_of(run);
  }
  for (const ReportedRun& run : runs) page += injected_table(run) + verdict_table(run);
  return page + "</section>\n";
}

std::string metrics_section(const std::vector<ReportedRun>& runs) {
  std::string page =
      "<section id=\"metrics\" aria-labelledby=\"metrics-h\"><h2 id=\"metrics-h\">How well it "
      "diagnosed</h2>\n";
  const bool has_truth = std::any_of(runs.begin(), runs.end(),
                                     [](const ReportedRun& run) { return run.record.has_truth; });
  if (!has_truth) {
    return page +
           "<p>Rates, delays and confusion compare verdicts with injected faults. This log has no "
           "TRUTH, so they cannot be told.</p></section>\n";
  }
  std::vector<HtmlTable::Column> columns{{"metric"}};
  for (const ReportedRun& run : runs) {
    columns.push_back({run.label.empty() ? "value" : "run " + run.label, true});
  }
  columns.push_back({"what it is"});
  HtmlTable table("Metrics, in cycles that have both a verdict and a truth", columns);
  for (const MetricRow& row : kMetricRows) {
    std::vector<std::string> cells{row.name};
    for (const ReportedRun& run : runs) {
      cells.push_back(run.record.has_truth ? row.text(run) : "no TRUTH");
    }
    cells.emplace_back(row.meaning);
    table.add(cells);
  }
  page += table.text();
  for (const ReportedRun& run : runs) page += outcome_table(run) + confusion_table(run);
  return page +
         "<p class=\"quiet\">An alarm is a verdict of isolated, ambiguous or unexplained. Faults "
         "of "
         "frames on the bus are no faults of the plant: to call them one is a false alarm.</p>"
         "</section>\n";
}

}  // namespace faultline

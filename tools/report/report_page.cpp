#include "tools/report/report_page.h"

#include <algorithm>
#include <array>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/model/digest.h"
#include "tools/report/chart_data.h"
#include "tools/report/html_text.h"
#include "tools/report/page_assets.h"
#include "tools/report/page_sections.h"

namespace faultline {
namespace {

std::vector<ReportedRun> evaluated_runs(std::vector<RunRecord> records) {
  std::vector<ReportedRun> runs;
  const bool are_two = records.size() > 1;
  for (RunRecord& record : records) {
    runs.push_back(evaluated(std::move(record)));
    if (are_two) runs.back().label = runs.size() == 1 ? "A" : "B";
  }
  return runs;
}

/// From the first cycle to the end of the last, of all runs.
std::array<double, 2> window_s(const std::vector<ReportedRun>& runs) {
  std::optional<std::array<double, 2>> window;
  for (const ReportedRun& run : runs) {
    if (!run.record.cycles) continue;
    const double from_s = run.record.time_s(run.record.cycles->from);
    const double until_s = run.record.time_s(run.record.cycles->until);
    if (!window) window = {from_s, until_s};
    *window = {std::min((*window)[0], from_s), std::max((*window)[1], until_s)};
  }
  return window.value_or(std::array<double, 2>{0.0, 1.0});
}

/// Of the first run that knows its faults.
std::vector<std::array<double, 2>> first_fault_stretches_s(const std::vector<ReportedRun>& runs) {
  for (const ReportedRun& run : runs) {
    auto stretches = fault_stretches_s(run);
    if (!stretches.empty()) return stretches;
  }
  return {};
}

/// Where one may want to look: the stretches of truth and verdict of the first run.
std::string stretch_options(const ReportedRun& run) {
  constexpr std::size_t kMost = 50;
  std::string options = "<option value=\"\">choose</option>\n";
  std::size_t count = 0;
  const auto add = [&](const CycleRange& cycles, const std::string& words) {
    if (++count > kMost) return;
    options +=
        fmt::format("<option value=\"{} {}\">{}: {:.5g} to {:.5g} s</option>\n",
                    run.record.time_s(cycles.from), run.record.time_s(cycles.until), html(words),
                    run.record.time_s(cycles.from), run.record.time_s(cycles.until));
  };
  for (const TruthStretch& stretch : run.truth) {
    if (!stretch.faults.empty()) {
      add(stretch.cycles, fmt::format("fault {}", fmt::join(stretch.faults, ", ")));
    }
  }
  for (const VerdictStretch& stretch : run.record.verdicts) {
    add(stretch.cycles, verdict_words(stretch));
  }
  return options;
}

std::string window_form(const ReportedRun& run) {
  return fmt::format(
      "<form id=\"window\" hidden aria-label=\"Time that all charts show\">\n"
      "<label>from <input id=\"from\" type=\"number\" step=\"any\"> s</label>\n"
      "<label>to <input id=\"until\" type=\"number\" step=\"any\"> s</label>\n"
      "<button type=\"submit\">Show</button> <button type=\"button\" id=\"whole\">Whole "
      "run</button>"
      "\n<label>Go to <select id=\"stretch\">{}</select></label></form>\n",
      stretch_options(run));
}

constexpr char kNavigation[] =
    "<nav aria-label=\"Sections\"><ul><li><a href=\"#timeline\">Timeline</a></li><li><a "
    "href=\"#metrics\">Metrics</a></li><li><a href=\"#residuals\">Residuals</a></li><li><a "
    "href=\"#signals\">Signals</a></li><li><a href=\"#bank\">Structure and certificate</a></li><li>"
    "<a href=\"#traffic\">Frames and latencies</a></li><li><a href=\"#source\">How to repeat it</a>"
    "</li></ul></nav>\n";

}  // namespace

ReportedRun evaluated(RunRecord record) {
  ReportedRun run;
  if (record.has_truth && record.cycles) {
    run.truth = truth_stretches(record.faults, *record.cycles);
    run.metrics = diagnosis_metrics(run.truth, record.verdicts);
  }
  run.record = std::move(record);
  return run;
}

std::vector<std::array<double, 2>> fault_stretches_s(const ReportedRun& run) {
  std::vector<CycleRange> ranges;
  for (const TruthStretch& stretch : run.truth) {
    if (!stretch.faults.empty()) ranges.push_back(stretch.cycles);
  }
  if (ranges.empty()) return {};
  const double length_s = run.record.time_s(run.record.cycles->until - run.record.cycles->from);
  constexpr double kLeastGap = 1.0 / 4000.0;
  return stretches_s(ranges, run.record.sample_time_s, kLeastGap * length_s);
}

std::string html_page(const std::string& title, const std::string& body, const std::string& data) {
  const PageAssets& assets = page_assets();
  // Only scripts that carry this number run, whatever a name in a log tries: it depends on all that
  // is in the page, so no name can know it.
  const std::string nonce = text_digest(body + data);
  const std::string scripts =
      data.empty() ? ""
                   : fmt::format(
                         "<script type=\"application/json\" id=\"data\">{1}</script>\n"
                         "<script nonce=\"{0}\">{2}</script>\n<script nonce=\"{0}\">{3}</script>\n",
                         nonce, data, assets.dygraph_script, assets.report_script);
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src "
      "'nonce-{0}'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action "
      "'none'\">"
      "\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<meta name=\"color-scheme\" content=\"light dark\">\n<title>{1}</title>\n"
      "<link rel=\"icon\" "
      "href=\"data:,\">\n<style>{2}\n{3}</style>\n</head>\n<body>\n{4}{5}</body>\n</html>\n",
      nonce, html(title), assets.dygraph_style, assets.report_style, body, scripts);
}

std::string report_page(std::vector<RunRecord> records, const std::string& version) {
  const std::vector<ReportedRun> runs = evaluated_runs(std::move(records));
  std::string name = runs.front().record.name();
  if (runs.size() > 1) name += " and " + runs[1].record.name();
  ChartData charts;
  std::string body = fmt::format(
      "<a class=\"skip\" href=\"#main\">Skip to the report</a>\n<header><h1>{}</h1>\n<p "
      "class=\"quiet\">Fault diagnosis report</p>{}</header>\n<main id=\"main\">\n",
      html(name), kNavigation);
  body += overview_section(runs) + timeline_section(runs) + metrics_section(runs);
  body +=
      "<noscript><p class=\"remark\">Charts need JavaScript; all else on this page does not."
      "</p></noscript>\n";
  body += window_form(runs.front());
  body += residual_section(runs, charts) + signal_section(runs, charts);
  body += bank_section(runs) + traffic_section(runs) + source_section(runs, version);
  body += "</main>\n";
  return html_page(name + " - fault diagnosis report", body,
                   charts.json(window_s(runs), first_fault_stretches_s(runs)));
}

}  // namespace faultline

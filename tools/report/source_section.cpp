#include <ctime>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/lcm/log_reader.h"
#include "tools/report/html_table.h"
#include "tools/report/html_text.h"
#include "tools/report/page_sections.h"

namespace faultline {
namespace {

/// "2026-11-22 14:01:12 UTC"; nothing for what is no time of this era.
std::string date_text(std::int64_t utime) {
  constexpr std::int64_t kPerSecond = 1'000'000;
  constexpr std::int64_t kYear2200 = 7'258'118'400;
  if (utime < 0 || utime / kPerSecond > kYear2200) return {};
  return fmt::format("{:%Y-%m-%d %H:%M:%S} UTC",
                     fmt::gmtime(static_cast<std::time_t>(utime / kPerSecond)));
}

std::string per_cent(const std::optional<double>& rate) {
  return rate ? fmt::format("{:.4g} %", 100.0 * *rate) : std::string("–");
}

/// What is missing or wrong, in sentences.
std::vector<std::string> remarks_of(const RunRecord& record) {
  std::vector<std::string> remarks = record.remarks;
  if (record.parts.empty()) {
    remarks.emplace_back(
        "The log has no RUN: scenario, plant and bank are not known, names are by "
        "position, and times follow from the samples' stamps.");
  } else if (!record.bank) {
    remarks.emplace_back("The log has no whole bank: names are by position.");
  }
  if (!record.has_truth) {
    remarks.emplace_back(
        "The log has no TRUTH, as of a real unit: no rates of detection and false "
        "alarms, no delays.");
  }
  if (!record.cycles) remarks.emplace_back("The log holds no samples and no residuals.");
  if (record.stats && record.stats->is_final == 0) {
    remarks.emplace_back("The log ends before the run did.");
  }
  if (!record.stats) remarks.emplace_back("The log has no STATS, or ends before the first.");
  if (record.runs_before > 0) {
    remarks.push_back(fmt::format("The log holds {} earlier run{}; this is the last.",
                                  record.runs_before, record.runs_before == 1 ? "" : "s"));
  }
  for (const FileDamage& damage : record.damages) {
    constexpr std::size_t kMostRemarks = 20;
    if (remarks.size() == kMostRemarks) {
      remarks.push_back(
          fmt::format("{} stretches of the log are damaged in all.", record.damages.size()));
      break;
    }
    remarks.push_back(describe(damage.file, damage.damage) + ".");
  }
  if (record.undecodable > 0) {
    remarks.push_back(fmt::format("{} messages on our channels are not of our types, or damaged.",
                                  record.undecodable));
  }
  return remarks;
}

std::string tile(const std::string& name, const std::string& value, const std::string& note) {
  return fmt::format("<div><dt>{}</dt><dd>{}<small>{}</small></dd></div>\n", html(name),
                     html(value), html(note));
}

std::string longest_delay(const ReportedRun& run,
                          std::optional<std::int64_t> FaultOutcome::*which) {
  std::optional<std::int64_t> longest;
  for (const FaultOutcome& outcome : run.metrics.outcomes) {
    if (outcome.*which) longest = std::max(longest.value_or(0), *(outcome.*which));
  }
  return longest ? fmt::format("{:.4g} s", run.record.time_s(*longest)) : std::string("–");
}

std::string tiles_of(const ReportedRun& run) {
  const RunRecord& record = run.record;
  std::string tiles = "<dl class=\"tiles\">\n";
  if (record.cycles) {
    const std::int64_t cycles = record.cycles->until - record.cycles->from;
    tiles += tile("Length", fmt::format("{:.6g} s", record.time_s(cycles)),
                  fmt::format("{} cycles of {:.4g} s{}", cycles, record.sample_time_s,
                              record.is_sample_time_measured ? ", measured" : ""));
  }
  if (!record.verdicts.empty()) {
    tiles += tile("Last verdict", verdict_words(record.verdicts.back()),
                  fmt::format("since {:.6g} s", record.time_s(record.verdicts.back().cycles.from)));
  }
  if (record.has_truth) {
    tiles += tile("TDR", per_cent(run.metrics.true_detection_rate()), "true detection rate");
    tiles += tile("FAR", per_cent(run.metrics.false_alarm_rate()), "false-alarm rate");
    tiles +=
        tile("FIA", per_cent(run.metrics.fault_isolation_accuracy()), "fault isolation accuracy");
    tiles +=
        tile("Detection delay", longest_delay(run, &FaultOutcome::detection_delay), "the longest");
    tiles +=
        tile("Isolation delay", longest_delay(run, &FaultOutcome::isolation_delay), "the longest");
  }
  if (record.stats) {
    tiles += tile("Frames lost", fmt::format("{}", record.stats->frames_dropped),
                  fmt::format("of {} received and lost",
                              static_cast<double>(record.stats->frames_received) +
                                  static_cast<double>(record.stats->frames_dropped)));
  }
  return tiles + "</dl>\n";
}

std::string event_table(const ReportedRun& run) {
  const RunRecord& record = run.record;
  HtmlTable table(fmt::format("Events{}{}", run.of_run(),
                              record.event_count > record.events.size()
                                  ? fmt::format(": the first of {}", record.event_count)
                                  : std::string()),
                  {{"time", true}, {"severity"}, {"source"}, {"text"}});
  for (const event_t& event : record.events) {
    table.add({event.cycle >= 0 ? fmt::format("{:.6g} s", record.time_s(event.cycle)) : "–",
               event.severity, event.source, event.text});
  }
  return table.is_empty() ? "<p>No events.</p>\n" : table.text();
}

std::string parts_of(const ReportedRun& run) {
  const RunRecord& record = run.record;
  HtmlTable table("Files that the run was made from" + run.of_run() + ", as the log carries them",
                  {{"part"}, {"name"}, {"digest"}, {"complete"}});
  std::string texts;
  for (const RunParts::Part& part : record.parts) {
    table.add({part.part, part.name, part.digest, part.is_whole() ? "yes" : "NO"});
    constexpr std::size_t kMostText = 100'000;  // the page stays one that can be sent
    const std::string text = part.text();
    const bool is_told = part.part != "bank" && part.part.rfind("data:", 0) != 0;
    if (!is_told || text.size() > kMostText) continue;
    texts += fmt::format("<details><summary>{}: {}</summary><pre><code>{}</code></pre></details>\n",
                         html(part.part), html(part.name), html(text));
  }
  return (table.is_empty() ? std::string() : table.text()) + texts;
}

}  // namespace

std::string overview_section(const std::vector<ReportedRun>& runs) {
  std::string page =
      "<section id=\"overview\" aria-labelledby=\"overview-h\"><h2 id=\"overview-h\">At a glance"
      "</h2>\n";
  for (const ReportedRun& run : runs) {
    if (!run.label.empty()) {
      page += fmt::format("<h3><span class=\"swatch{}\"></span>Run {}: {}</h3>\n",
                          run.label == "B" ? " b" : "", run.label, html(run.record.name()));
    }
    page += fmt::format(
        "<p class=\"quiet\">{}{}{}</p>\n",
        html(fmt::format("{}", fmt::join(run.record.files, ", "))),
        run.record.run_id.empty() ? "" : ", run " + html(run.record.run_id),
        date_text(run.record.first_utime).empty() ? "" : ", " + date_text(run.record.first_utime));
    for (const std::string& remark : remarks_of(run.record)) {
      page += fmt::format("<p class=\"remark\">{}</p>\n", html(remark));
    }
    page += tiles_of(run);
  }
  return page + "</section>\n";
}

std::string source_section(const std::vector<ReportedRun>& runs, const std::string& version) {
  std::string page =
      "<section id=\"source\" aria-labelledby=\"source-h\"><h2 id=\"source-h\">Events, and how to "
      "repeat it</h2>\n";
  for (const ReportedRun& run : runs) {
    if (!run.label.empty()) page += fmt::format("<h3>Run {}</h3>\n", run.label);
    page += event_table(run) + parts_of(run);
    if (run.record.scenario) {
      page += fmt::format(
          "<p>Repeat it with <code>faultline run {}</code> (seed {}); check the "
          "recorded decisions to the bit with <code>faultline replay {}</code>.</p>\n",
          html(run.record.scenario->file.string()), run.record.scenario->seed,
          html(fmt::format("{}", fmt::join(run.record.files, " "))));
    }
  }
  return page + fmt::format(
                    "<p class=\"quiet\">Report by faultline {}; charts by dygraphs 2 (MIT "
                    "licence). This page needs no network and no other file.</p></section>\n",
                    html(version));
}

}  // namespace faultline

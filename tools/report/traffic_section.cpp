#include <algorithm>
#include <array>
#include <cmath>

#include <faultline/latency_histogram_t.hpp>
#include <fmt/format.h>

#include "tools/bench/latency_table.h"
#include "tools/report/html_table.h"
#include "tools/report/html_text.h"
#include "tools/report/page_sections.h"
#include "tools/report/timeline_svg.h"

namespace faultline {
namespace {

using Milliseconds = std::chrono::duration<double, std::milli>;
using Microseconds = std::chrono::duration<double, std::micro>;

std::string ms_text(std::chrono::nanoseconds time) {
  return fmt::format("{:.4g} ms", Milliseconds(time).count());
}
std::string us_text(std::chrono::nanoseconds time) {
  return fmt::format("{:.4g} µs", Microseconds(time).count());
}

std::string account_table(const ReportedRun& run) {
  if (!run.record.stats) {
    return "<p>The log has no STATS: how many frames were sent, received and lost cannot be told."
           "</p>\n";
  }
  const stats_t& stats = *run.record.stats;
  HtmlTable table("Frames and samples" + run.of_run() +
                      (stats.is_final != 0 ? "" : " (the log ends before the run did)"),
                  {{"count"}, {"value", true}, {"what it is"}});
  struct Row {
    const char* name;
    std::int64_t value;
    const char* meaning;
  };
  const std::array<Row, 13> rows{{
      {"frames sent", stats.frames_sent, "by plant and controller"},
      {"send errors", stats.send_errors, "frames that the bus did not take"},
      {"frames received", stats.frames_received, "by the diagnosis"},
      {"frames dropped", stats.frames_dropped, "lost between bus and diagnosis"},
      {"frames unlogged", stats.frames_unlogged, "received, but missing from the log"},
      {"samples", stats.samples, "cycles that the diagnosis closed"},
      {"bad samples", stats.bad_samples, "a value was missing, late or damaged"},
      {"late cycles", stats.late_cycles, "acted on an older command"},
      {"overruns", stats.overruns, "began a whole cycle after their deadline"},
      {"skipped cycles", stats.skipped_cycles, "of these, not sent"},
      {"records dropped", stats.records_dropped, "diagnoses that found the queue full"},
      {"resets", stats.resets, "of the sampler"},
      {"allocations", stats.allocations, "of the diagnosis thread after warm-up; -1: not counted"},
  }};
  for (const Row& row : rows) table.add({row.name, fmt::format("{}", row.value), row.meaning});
  return table.text();
}

std::string channel_table(const ReportedRun& run) {
  HtmlTable table("Messages" + run.of_run() + ": published by the run, found in the log",
                  {{"channel"}, {"published", true}, {"in the log", true}, {"gaps", true}});
  for (const auto& [name, account] : run.record.channels) {
    std::string published = "–";
    if (run.record.stats) {
      const stats_t& stats = *run.record.stats;
      for (std::size_t i = 0; i < std::min(stats.channel.size(), stats.published.size()); ++i) {
        if (stats.channel[i] == name) published = fmt::format("{}", stats.published[i]);
      }
    }
    table.add({name, published, fmt::format("{}", account.logged),
               account.missing > 0 ? fmt::format("{} MISSING", account.missing) : "0"});
  }
  return table.is_empty() ? std::string() : table.text();
}

/// A histogram of at most `kBars` bars of equal width between the extremes.
std::string histogram(const LatencyHistogram& values, const std::string& what,
                      std::string (*text)(std::chrono::nanoseconds)) {
  constexpr std::size_t kBars = 40;
  const auto least = static_cast<double>(values.min().count());
  const auto span = std::max(static_cast<double>(values.max().count()) - least, 1.0);
  std::vector<double> counts(kBars, 0.0);
  for (const LatencyHistogram::Bucket& bucket : values.buckets()) {
    const double share = (static_cast<double>(bucket.upper.count()) - least) / span;
    const double bar =
        std::clamp(share * static_cast<double>(kBars), 0.0, static_cast<double>(kBars - 1));
    counts[static_cast<std::size_t>(bar)] += static_cast<double>(bucket.count);
  }
  const std::string label =
      fmt::format("{}: {} values from {} to {}, median {}, 99 % below {}", what, values.count(),
                  text(values.min()), text(values.max()), text(values.percentile(50.0)),
                  text(values.percentile(99.0)));
  return fmt::format("<figure>{}<figcaption><strong>{}</strong></figcaption></figure>\n",
                     histogram_svg(counts, {text(values.min()), text(values.max())}, label),
                     html(label));
}

std::string period_part(const ReportedRun& run) {
  const TrafficRecord& traffic = run.record.traffic;
  std::vector<RecordedIdentifier> identifiers = traffic.identifiers();
  if (identifiers.empty()) return "<p>The log holds no frames.</p>\n";
  HtmlTable table("Periods of the messages in the log" + run.of_run(),
                  {{"message"},
                   {"bus", true},
                   {"frames", true},
                   {"period, median", true},
                   {"mean", true},
                   {"jitter (deviation)", true},
                   {"shortest", true},
                   {"longest", true},
                   {"backward stamps", true}});
  std::string histograms;
  std::size_t drawn = 0;
  constexpr std::size_t kMostHistograms = 16;
  for (const RecordedIdentifier& message : identifiers) {
    const PeriodStatistics& periods = message.periods;
    const std::string name = message_name(message, run.record.dbc);
    const bool has_gaps = periods.intervals() > 0;
    table.add({name, fmt::format("{}", message.bus), fmt::format("{}", periods.frames()),
               has_gaps ? ms_text(message.gaps.percentile(50.0)) : "–",
               has_gaps ? fmt::format("{:.4g} ms", 1e3 * periods.mean_s()) : "–",
               has_gaps ? fmt::format("{:.4g} ms", 1e3 * periods.deviation_s()) : "–",
               has_gaps ? ms_text(periods.least()) : "–",
               has_gaps ? ms_text(periods.greatest()) : "–",
               fmt::format("{}", periods.backward())});
    if (has_gaps && drawn < kMostHistograms) {
      ++drawn;
      histograms += histogram(message.gaps, "Periods of " + name, ms_text);
    }
  }
  std::string page = table.text() + fmt::format("<p>{} frames in the log", traffic.frames());
  if (traffic.error_frames() > 0) page += fmt::format(", {} error frames", traffic.error_frames());
  if (traffic.malformed() > 0) page += fmt::format(", {} malformed", traffic.malformed());
  if (traffic.uncounted() > 0) {
    page += fmt::format(", {} of further identifiers", traffic.uncounted());
  }
  return page + fmt::format(".</p>\n<div class=\"histograms\">{}</div>\n", histograms);
}

std::string latency_part(const ReportedRun& run) {
  HtmlTable table(
      "Latency per stage" + run.of_run() + ": from the frame's arrival to the diagnosis",
      {{"stage"},
       {"values", true},
       {"p50", true},
       {"p90", true},
       {"p99", true},
       {"p99.9", true},
       {"longest", true},
       {"remarks"}});
  std::string histograms;
  const std::int32_t stages = run.record.stats ? run.record.stats->stage_count : 0;
  for (std::int32_t i = 0; i < stages; ++i) {
    const StageLatency stage =
        to_stage_latency(run.record.stats->latency[static_cast<std::size_t>(i)]);
    const LatencyHistogram& values = stage.histogram;
    if (values.count() == 0) continue;
    std::string remarks;
    if (stage.cycles_per_value > 1) {
      remarks = fmt::format("one cycle in {} is timed", stage.cycles_per_value);
    }
    if (values.corrected() > 0) {
      remarks += fmt::format("{}{} filled in", remarks.empty() ? "" : "; ", values.corrected());
    }
    table.add({stage.stage, fmt::format("{}", values.count()), us_text(values.percentile(50.0)),
               us_text(values.percentile(90.0)), us_text(values.percentile(99.0)),
               us_text(values.percentile(99.9)), us_text(values.max()), remarks});
    histograms += histogram(values, "Latency of " + stage.stage, us_text);
  }
  if (table.is_empty()) return "<p>No latencies were measured.</p>\n";
  return table.text() + fmt::format("<div class=\"histograms\">{}</div>\n", histograms);
}

}  // namespace

std::string traffic_section(const std::vector<ReportedRun>& runs) {
  std::string page =
      "<section id=\"traffic\" aria-labelledby=\"traffic-h\"><h2 id=\"traffic-h\">Frames, periods, "
      "latencies</h2>\n";
  for (const ReportedRun& run : runs) {
    if (!run.label.empty()) page += fmt::format("<h3>Run {}</h3>\n", run.label);
    page += account_table(run) + channel_table(run) + period_part(run) + latency_part(run);
  }
  return page + "<p class=\"quiet\">Heights of the histograms are logarithmic.</p></section>\n";
}

}  // namespace faultline

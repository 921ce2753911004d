#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include <fmt/format.h>

#include "tools/report/page_sections.h"

namespace faultline {
namespace {

/// Marks nearer to each other than this share of the run are drawn as one.
constexpr double kLeastGap = 1.0 / 4000.0;

std::string label_in(const ReportedRun& run, const std::string& name) {
  return run.label.empty() ? name : fmt::format("{} ({})", name, run.label);
}

ChartSeries line_of(const ReportedRun& run, std::size_t index, const std::string& name,
                    const EnvelopeSeries& values) {
  return {.label = label_in(run, name),
          .run = index,
          .sample_time_s = run.record.sample_time_s,
          .values = values};
}

std::string range_text(const ReportedRun& run, const EnvelopeSeries& values) {
  if (values.is_empty()) return "No values.";
  return fmt::format("From {:.4g} to {:.4g}; largest magnitude at {:.6g} s.", values.smallest(),
                     values.largest(), run.record.time_s(values.peak_cycle()));
}

std::string prefixed(const ReportedRun& run, const std::string& text) {
  return run.label.empty() ? text : fmt::format("Run {}: {} ", run.label, text);
}

std::string residual_text(const ReportedRun& run, const LoggedResidual& residual) {
  if (residual.values.is_empty()) return "No values.";
  const double largest =
      std::max(std::abs(residual.values.smallest()), std::abs(residual.values.largest()));
  std::string text =
      fmt::format("Largest {} {:.4g} at {:.6g} s", residual.is_signed ? "|r|" : "value", largest,
                  run.record.time_s(residual.values.peak_cycle()));
  if (residual.threshold.is_constant()) {
    text += fmt::format(", threshold {:.4g}", residual.threshold.largest());
  } else if (!residual.threshold.is_empty()) {
    text += fmt::format(", threshold {:.4g} to {:.4g}", residual.threshold.smallest(),
                        residual.threshold.largest());
  }
  if (residual.fired.empty()) return text + "; never fired.";
  const std::int64_t cycles = std::accumulate(
      residual.fired.begin(), residual.fired.end(), std::int64_t{0},
      [](std::int64_t sum, const CycleRange& range) { return sum + range.until - range.from; });
  return text + fmt::format("; fired {} time{}, first at {:.6g} s, {:.4g} s in all.",
                            residual.fired.size(), residual.fired.size() == 1 ? "" : "s",
                            run.record.time_s(residual.fired.front().from),
                            run.record.time_s(cycles));
}

void add_residual(Chart& chart, const ReportedRun& run, std::size_t index,
                  const LoggedResidual& residual) {
  chart.summary += prefixed(run, residual_text(run, residual));
  chart.series.push_back(line_of(run, index, residual.name, residual.values));
  chart.series.push_back(line_of(run, index, "τ " + residual.name, residual.threshold));
  chart.series.back().is_threshold = true;
  if (residual.is_signed) {
    chart.series.push_back(line_of(run, index, "-τ " + residual.name, residual.threshold));
    chart.series.back().is_threshold = true;
    chart.series.back().sign = -1.0;
  }
  const CycleRange cycles = run.record.cycles.value_or(CycleRange{});
  chart.fired.resize(index + 1);
  chart.fired[index] = stretches_s(residual.fired, run.record.sample_time_s,
                                   kLeastGap * run.record.time_s(cycles.until - cycles.from));
}

/// One chart per name; a name that both runs have is one chart.
class ChartsByName {
 public:
  Chart& at(const std::string& name) {
    for (Chart& chart : charts_) {
      if (chart.title == name) return chart;
    }
    charts_.push_back({.title = name, .unit = {}, .summary = {}});
    return charts_.back();
  }

  /// @return the elements of all, in a grid.
  std::string add_to(ChartData& data) {
    std::string page = "<div class=\"grid\">\n";
    for (Chart& chart : charts_) page += data.add(std::move(chart));
    return page + "</div>\n";
  }

  [[nodiscard]] bool is_empty() const noexcept { return charts_.empty(); }

 private:
  std::vector<Chart> charts_;
};

std::string signals(const std::vector<ReportedRun>& runs,
                    std::vector<LoggedSignal> RunRecord::*which, const std::string& title,
                    ChartData& data) {
  ChartsByName charts;
  for (std::size_t index = 0; index < runs.size(); ++index) {
    for (const LoggedSignal& signal : runs[index].record.*which) {
      Chart& chart = charts.at(signal.name);
      chart.unit = signal.unit;
      chart.summary += prefixed(runs[index], range_text(runs[index], signal.values));
      chart.series.push_back(line_of(runs[index], index, signal.name, signal.values));
    }
  }
  if (charts.is_empty()) return fmt::format("<h3>{}</h3><p>None are in the log.</p>\n", title);
  return fmt::format("<h3>{}</h3>\n", title) + charts.add_to(data);
}

std::string estimates(const std::vector<ReportedRun>& runs, ChartData& data) {
  constexpr std::size_t kMostPoints = 20'000;
  ChartsByName charts;
  for (std::size_t index = 0; index < runs.size(); ++index) {
    const ReportedRun& run = runs[index];
    for (const auto& [fault, points] : run.record.estimates) {
      Chart& chart = charts.at(fault);
      chart.has_bands = true;
      chart.summary += prefixed(
          run, fmt::format("{} estimates of its size, the last {:.4g}{}.", points.size(),
                           points.back().value,
                           points.back().band >= 0.0 ? fmt::format(" ± {:.2g}", points.back().band)
                                                     : std::string(" without a band")));
      ChartSeries series{.label = label_in(run, fault), .run = index};
      const std::size_t step = points.size() / kMostPoints + 1;
      for (std::size_t i = 0; i < points.size(); i += step) {
        const double band = std::max(points[i].band, 0.0);
        series.points.push_back({run.record.time_s(points[i].cycle), points[i].value - band,
                                 points[i].value, points[i].value + band});
      }
      chart.series.push_back(std::move(series));
    }
  }
  if (charts.is_empty()) return {};
  return "<h3>Estimated fault sizes</h3><p class=\"quiet\">Band: the proved bound where there is "
         "one, else one standard deviation.</p>\n" +
         charts.add_to(data);
}

}  // namespace

std::string residual_section(const std::vector<ReportedRun>& runs, ChartData& data) {
  std::string page =
      "<section id=\"residuals\" aria-labelledby=\"residuals-h\"><h2 id=\"residuals-h\">Residuals"
      "</h2>\n";
  ChartsByName charts;
  for (std::size_t index = 0; index < runs.size(); ++index) {
    for (const LoggedResidual& residual : runs[index].record.residuals) {
      add_residual(charts.at(residual.name), runs[index], index, residual);
    }
  }
  if (charts.is_empty()) return page + "<p>The log holds no RESIDUAL.</p></section>\n";
  if (runs.size() == 1) {
    page +=
        "<p class=\"quiet\"><span class=\"swatch\"></span>residual <span class=\"swatch t\">"
        "</span>threshold <span class=\"swatch f\"></span>fired <span class=\"swatch w\"></span>"
        "a fault acts. Drag to zoom, Shift-drag to move, double-click for the whole run; all "
        "charts move together.</p>\n";
  } else {
    page +=
        "<p class=\"quiet\"><span class=\"swatch\"></span>run A <span class=\"swatch b\"></span>"
        "run B <span class=\"swatch t\"></span>threshold <span class=\"swatch f\"></span>fired "
        "in A, below it in B. Drag to zoom; all charts move together.</p>\n";
  }
  return page + charts.add_to(data) + "</section>\n";
}

std::string residual_charts(const ReportedRun& run, const std::vector<std::string>& names,
                            ChartData& data) {
  ChartsByName charts;
  for (const LoggedResidual& residual : run.record.residuals) {
    const bool is_wanted =
        names.empty() || std::find(names.begin(), names.end(), residual.name) != names.end();
    if (!is_wanted) continue;
    Chart& chart = charts.at(residual.name);
    add_residual(chart, run, 0, residual);
    chart.faults = fault_stretches_s(run);
  }
  return charts.add_to(data);
}

std::string signal_section(const std::vector<ReportedRun>& runs, ChartData& data) {
  return "<section id=\"signals\" aria-labelledby=\"signals-h\"><h2 id=\"signals-h\">Estimates, "
         "outputs, inputs</h2>\n" +
         estimates(runs, data) + signals(runs, &RunRecord::outputs, "Outputs", data) +
         signals(runs, &RunRecord::inputs, "Inputs", data) + "</section>\n";
}

}  // namespace faultline

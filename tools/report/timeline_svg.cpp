#include "tools/report/timeline_svg.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <fmt/format.h>

#include "tools/report/html_text.h"

namespace faultline {
namespace {

constexpr int kLaneHeight = 34, kBarHeight = 24, kAxisHeight = 24, kNameHeight = 16;
/// Widths are per cent of the picture's. Bars narrower than this are joined with their neighbours,
/// those as wide as a letter carry their words.
constexpr double kNarrow = 0.05, kPerLetter = 0.85;

std::vector<TimelineBar> joined(const std::vector<TimelineBar>& bars, double cycles) {
  const auto is_narrow = [&](const TimelineBar& bar) {
    return 100.0 * static_cast<double>(bar.cycles.until - bar.cycles.from) < kNarrow * cycles;
  };
  std::vector<TimelineBar> drawn;
  bool was_narrow = false;
  for (const TimelineBar& bar : bars) {
    const bool is_close =
        !drawn.empty() &&
        100.0 * static_cast<double>(bar.cycles.from - drawn.back().cycles.until) < kNarrow * cycles;
    if (is_narrow(bar) && was_narrow && is_close) {
      drawn.back().cycles.until = bar.cycles.until;
      drawn.back().words = "changes often";
      drawn.back().css = "changing";
    } else {
      drawn.push_back(bar);
    }
    was_narrow = is_narrow(bar);
  }
  return drawn;
}

/// 1, 2 or 5 times a power of ten: some eight steps to `span`.
double tick_step(double span) {
  const double power = std::pow(10.0, std::floor(std::log10(span / 8.0)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (span / (factor * power) <= 10.0) return factor * power;
  }
  return 10.0 * power;
}

std::string axis_svg(double from_s, double until_s, int top) {
  std::string svg;
  const double span = until_s - from_s;
  if (!(span > 0.0) || !std::isfinite(span)) return svg;
  const double step = tick_step(span);
  constexpr int kMostTicks = 12;  // far from zero, times need not be told apart
  for (int tick = 0; tick < kMostTicks; ++tick) {
    const double time_s = (std::ceil(from_s / step) + tick) * step;
    if (time_s > until_s) break;
    const double percent = 100.0 * (time_s - from_s) / span;
    const char* const anchor = percent < 3.0 ? "start" : percent > 97.0 ? "end" : "middle";
    svg += fmt::format(
        "<line class=\"axis\" x1=\"{0:.3f}%\" x2=\"{0:.3f}%\" y1=\"0\" y2=\"{1}\"/>"
        "<text x=\"{0:.3f}%\" y=\"{2}\" text-anchor=\"{3}\">{4:.6g} s</text>\n",
        percent, top + 4, top + 18, anchor, time_s);
  }
  return svg;
}

}  // namespace

std::string timeline_svg(const std::vector<TimelineLane>& lanes, CycleRange cycles,
                         double sample_time_s, const std::string& label) {
  const auto span = static_cast<double>(cycles.until - cycles.from);
  const int lane_height = kLaneHeight + kNameHeight;
  const int height = static_cast<int>(lanes.size()) * lane_height;
  std::string svg = fmt::format("<svg role=\"img\" aria-label=\"{}\" height=\"{}\">\n", html(label),
                                height + kAxisHeight);
  svg += axis_svg(static_cast<double>(cycles.from) * sample_time_s,
                  static_cast<double>(cycles.until) * sample_time_s, height);
  int top = 0;
  for (const TimelineLane& lane : lanes) {
    svg += fmt::format("<text x=\"2\" y=\"{}\">{}</text>\n", top + 13, html(lane.name));
    for (const TimelineBar& bar : joined(lane.bars, span)) {
      const double left = 100.0 * static_cast<double>(bar.cycles.from - cycles.from) / span;
      const double width =
          std::max(100.0 * static_cast<double>(bar.cycles.until - bar.cycles.from) / span, kNarrow);
      svg += fmt::format(
          "<g><title>{0}: {1:.6g} s to {2:.6g} s</title><rect class=\"{3}\" x=\"{4:.4f}%\" "
          "y=\"{5}\" width=\"{6:.4f}%\" height=\"{7}\" rx=\"2\"/>",
          html(bar.words), static_cast<double>(bar.cycles.from) * sample_time_s,
          static_cast<double>(bar.cycles.until) * sample_time_s, bar.css, left, top + kNameHeight,
          width, kBarHeight);
      if (width > kPerLetter * static_cast<double>(bar.words.size() + 1)) {
        svg += fmt::format("<text class=\"on\" x=\"{:.4f}%\" dx=\"5\" y=\"{}\">{}</text>", left,
                           top + kNameHeight + 17, html(bar.words));
      }
      svg += "</g>\n";
    }
    top += lane_height;
  }
  return svg + "</svg>\n";
}

std::string histogram_svg(const std::vector<double>& counts,
                          const std::array<std::string, 2>& edges, const std::string& label) {
  constexpr int kHeight = 80;
  const double largest = counts.empty() ? 0.0 : *std::max_element(counts.begin(), counts.end());
  std::string svg = fmt::format("<svg role=\"img\" aria-label=\"{}\" height=\"{}\">\n", html(label),
                                kHeight + 20);
  const double width = 100.0 / static_cast<double>(std::max<std::size_t>(counts.size(), 1));
  for (std::size_t i = 0; i < counts.size() && largest > 0.0; ++i) {
    if (counts[i] <= 0.0) continue;
    // Logarithmic: one late frame in a million is what one looks for.
    const double bar = std::max(2.0, kHeight * std::log1p(counts[i]) / std::log1p(largest));
    svg += fmt::format(
        "<rect class=\"bar\" x=\"{:.3f}%\" y=\"{:.1f}\" width=\"{:.3f}%\" "
        "height=\"{:.1f}\"/>\n",
        width * static_cast<double>(i), kHeight - bar, 0.9 * width, bar);
  }
  svg += fmt::format(
      "<text x=\"0\" y=\"{0}\">{1}</text><text x=\"100%\" y=\"{0}\" "
      "text-anchor=\"end\">{2}</text>\n",
      kHeight + 15, html(edges.front()), html(edges.back()));
  return svg +
         fmt::format("<line class=\"axis\" x1=\"0\" x2=\"100%\" y1=\"{0}\" y2=\"{0}\"/></svg>\n",
                     kHeight);
}

}  // namespace faultline

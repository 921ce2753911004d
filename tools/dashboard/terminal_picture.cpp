#include "tools/dashboard/terminal_picture.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>
#include <vector>

#include <fmt/format.h>

namespace faultline {
namespace {

/// Where the threshold stands in a bar.
constexpr double kThresholdShare = 0.75;
constexpr int kNameColumns = 14;
constexpr int kNumberColumns = 24;
constexpr int kShortestBar = 4;

/// Without what a terminal would obey, and ASCII only, so that a character is a column.
std::string printable(std::string_view text) {
  std::string result;
  for (const char letter : text) {
    const auto byte = static_cast<unsigned char>(letter);
    result += byte >= 0x20 && byte < 0x7f ? letter : '?';
  }
  return result;
}

std::string fitted(std::string text, int columns) {
  const auto width = static_cast<std::size_t>(std::max(columns, 0));
  if (text.size() > width) text.resize(width);
  return text;
}

std::string since(const LiveView& view) {
  const std::optional<double> age_s = view.verdict_age_s();
  return age_s ? fmt::format("  since {:.1f} s", *age_s) : std::string();
}

std::string bar(double ratio, int columns) {
  const auto mark = static_cast<int>(std::lround(kThresholdShare * columns));
  // A NaN is as long as can be: it is never below a threshold.
  const double share = std::isnan(ratio) ? 1.0 : std::clamp(ratio * kThresholdShare, 0.0, 1.0);
  const auto length = static_cast<int>(std::lround(share * columns));
  std::string text;
  for (int i = 0; i < columns; ++i) text += i == mark ? '|' : i < length ? '#' : ' ';
  return text;
}

std::string residual_line(const LiveView& view, std::size_t i, int columns) {
  const residual_t& residual = *view.residual();
  const double threshold = i < residual.threshold.size() ? residual.threshold[i] : 0.0;
  // The largest since the last picture: a peak between two is not lost.
  const double value = i < view.greatest().size() ? view.greatest()[i] : residual.evaluation[i];
  const bool is_fired = i < residual.fired.size() && residual.fired[i] != 0;
  const std::string name = fitted(printable(view.filter_name(i)), kNameColumns - 1);
  const int bar_columns = columns - kNameColumns - kNumberColumns;
  std::string text = fmt::format("{:<{}}", name, kNameColumns);
  if (bar_columns >= kShortestBar) text += bar(value / threshold, bar_columns);
  text += fmt::format(" {:>9.3g} / {:<9.3g}{}", value, threshold, is_fired ? "!" : " ");
  text = fitted(text, columns);
  return is_fired ? "\x1b[31m" + text + "\x1b[0m" : text;
}

std::string drops_text(const LiveView& view) {
  if (!view.stats()) return "no STATS yet";
  const stats_t& stats = *view.stats();
  return fmt::format(
      "frames {}  dropped {}  unlogged {}  bad samples {}  overruns {}  lost here {}",
      stats.frames_received, stats.frames_dropped, stats.frames_unlogged, stats.bad_samples,
      stats.overruns, view.lost());
}

std::string waiting_text(const std::string& url) {
  return fmt::format("waiting for the bench on {}", printable(url));
}

}  // namespace

std::string terminal_picture(const LiveView& view, TerminalSize size, const std::string& url,
                             LiveView::Clock::time_point now) {
  std::vector<std::string> lines;
  const bool is_running = view.is_running(now);
  const std::string verdict = printable(view.verdict_text()) + since(view);
  if (!is_running) lines.push_back(fitted(waiting_text(url), size.columns));
  if (!view.verdict_text().empty()) {
    const char* const prefix = is_running ? "" : "last: ";
    lines.push_back("\x1b[1m" + fitted(prefix + verdict, size.columns) + "\x1b[0m");
  }
  lines.push_back(fitted(drops_text(view), size.columns));
  if (view.residual()) {
    const std::size_t count = std::min(view.residual()->evaluation.size(), LiveView::kFilters);
    const auto room =
        static_cast<std::size_t>(std::max(size.rows - static_cast<int>(lines.size()), 0));
    const std::size_t shown = count <= room ? count : room > 0 ? room - 1 : 0;
    for (std::size_t i = 0; i < shown; ++i) lines.push_back(residual_line(view, i, size.columns));
    if (shown < count && room > 0) {
      lines.push_back(
          fitted(fmt::format("and {} more: the window is too low", count - shown), size.columns));
    }
  }
  lines.resize(std::min(lines.size(), static_cast<std::size_t>(std::max(size.rows, 1))));
  std::string text = "\x1b[H";
  for (std::size_t i = 0; i < lines.size(); ++i) {
    text += lines[i] + "\x1b[K";
    if (i + 1 < lines.size()) text += "\r\n";
  }
  return text + "\x1b[J";
}

std::string terminal_line(const LiveView& view, const std::string& url,
                          LiveView::Clock::time_point now) {
  if (!view.is_running(now)) return waiting_text(url);
  std::string text = printable(view.verdict_text()) + since(view);
  if (view.residual()) {
    const residual_t& residual = *view.residual();
    std::string fired;
    for (std::size_t i = 0; i < residual.fired.size(); ++i) {
      if (residual.fired[i] != 0) fired += " " + printable(view.filter_name(i));
    }
    text += fmt::format("  cycle {}  fired:{}", residual.cycle, fired.empty() ? " none" : fired);
  }
  return text + "  " + drops_text(view);
}

}  // namespace faultline

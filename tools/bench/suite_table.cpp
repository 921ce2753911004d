#include "tools/bench/suite_table.h"

#include <algorithm>
#include <cstdlib>
#include <string_view>

#include <unistd.h>

#include <fmt/format.h>
#include <sys/ioctl.h>

#include "tools/bench/verdict_report.h"

namespace faultline {
namespace {

using Status = ScenarioOutcome::Status;

constexpr std::size_t kMostNameColumns = 32;
/// Of the verdicts where the line may be as long as it likes, and at least.
constexpr std::size_t kMostTimelineColumns = 120;
constexpr std::size_t kFewestTimelineColumns = 16;

/// `text` as one line that cannot steer a terminal.
std::string printable(std::string text) {
  for (char& character : text) {
    const auto byte = static_cast<unsigned char>(character);
    if (byte < 0x20 || byte == 0x7F) character = '?';
  }
  return text;
}

/// At most `width` bytes of `text`; what is left out shows, and no character is cut in two.
std::string shortened(const std::string& text, std::size_t width) {
  if (text.size() <= width) return text;
  std::size_t end = width < 2 ? 0 : width - 2;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U) --end;
  return text.substr(0, end) + "..";
}

std::string coloured(std::string_view text, Status status, bool has_colour) {
  if (!has_colour) return std::string(text);
  const char* const colour = status == Status::kMet           ? "\x1b[32m"
                             : status == Status::kInterrupted ? "\x1b[33m"
                                                              : "\x1b[31m";
  return fmt::format("{}{}\x1b[0m", colour, text);
}

std::string with_thousands(double value) {
  std::string digits = fmt::format("{:.0f}", value);
  for (std::size_t at = digits.size(); at > 3; at -= 3) digits.insert(at - 3, ",");
  return digits;
}

std::string expectations_text(const ScenarioOutcome& outcome) {
  const auto expectations = decided_expectations(outcome);
  if (expectations.empty()) return "-";
  const auto met = std::count_if(expectations.begin(), expectations.end(),
                                 [](const DecidedExpectation& each) { return each.is_met(); });
  return fmt::format("{}/{}", met, expectations.size());
}

std::string speed_text(const ScenarioOutcome& outcome) {
  if (!outcome.result || outcome.result->wall_s <= 0.0) return "-";
  return with_thousands(static_cast<double>(outcome.result->counters.cycles) /
                        outcome.result->wall_s);
}

/// The columns before the verdicts: expectations with status, cycles per second, wall time.
struct Columns {
  std::size_t name = std::string_view("scenario").size();
  std::size_t expect = std::string_view("expect").size();
  std::size_t status = 0;

  /// All that is not a timeline, with what stands between the columns.
  [[nodiscard]] std::size_t total() const noexcept {
    return 2 + name + 2 + expect + 1 + status + 2 + kSpeed + 2 + kWall + 2;
  }
  static constexpr std::size_t kSpeed = 9, kWall = 7;
};

Columns columns_of(const std::vector<ScenarioOutcome>& outcomes) {
  Columns columns;
  for (const ScenarioOutcome& outcome : outcomes) {
    columns.name = std::max(columns.name, std::min(outcome.name.size(), kMostNameColumns));
    columns.expect = std::max(columns.expect, expectations_text(outcome).size());
    columns.status = std::max(columns.status, status_name(outcome.status()).size());
  }
  return columns;
}

/// What goes before the verdicts of a line.
std::string row_head(const ScenarioOutcome& outcome, const Columns& columns, bool has_colour) {
  const Status status = outcome.status();
  return fmt::format(
      "  {:<{}}  {:>{}} {}  {:>{}}  {:>{}.2f}  ", shortened(printable(outcome.name), columns.name),
      columns.name, expectations_text(outcome), columns.expect,
      coloured(fmt::format("{:<{}}", status_name(status), columns.status), status, has_colour),
      speed_text(outcome), Columns::kSpeed, outcome.wall_s, Columns::kWall);
}

std::size_t timeline_columns(const Columns& columns, const TableStyle& style) {
  const std::size_t head = columns.total();
  if (style.width == 0) return kMostTimelineColumns;
  return style.width > head + kFewestTimelineColumns ? style.width - head : kFewestTimelineColumns;
}

/// What was not met, and why the rest did not run.
std::string complaints(const std::vector<ScenarioOutcome>& outcomes) {
  std::string text;
  for (const ScenarioOutcome& outcome : outcomes) {
    std::string lines;
    for (const DecidedExpectation& each : decided_expectations(outcome)) {
      if (each.is_decided && !each.is_met()) {
        lines += fmt::format("    {}\n", expectation_text(each.outcome));
      }
    }
    if (!outcome.error.empty()) lines += fmt::format("    {}\n", outcome.error);
    if (!lines.empty()) text += fmt::format("  {}\n{}", printable(outcome.file.string()), lines);
  }
  return text.empty() ? "" : "\n" + text;
}

std::string sum(const std::vector<ScenarioOutcome>& outcomes) {
  const SuiteTally tally = tally_of(outcomes);
  double wall_s = 0.0;
  for (const ScenarioOutcome& outcome : outcomes) wall_s += outcome.wall_s;
  std::string text = fmt::format("{} scenario{}: {} met", outcomes.size(),
                                 outcomes.size() == 1 ? "" : "s", tally.met);
  const auto add = [&](std::size_t count, const char* what) {
    if (count > 0) text += fmt::format(", {} {}", count, what);
  };
  add(tally.not_met, "NOT MET");
  add(tally.stopped, "stopped early");
  add(tally.interrupted, "interrupted");
  add(tally.not_run, "not run");
  return fmt::format("\n  {}; {} of {} expectations met, {:.2f} s\n", text, tally.expectations_met,
                     tally.expectations, wall_s);
}

}  // namespace

TableStyle style_of(std::FILE* out) {
  TableStyle style;
  const int descriptor = ::fileno(out);
  if (::isatty(descriptor) != 1) return style;
  winsize size{};
  if (::ioctl(descriptor, TIOCGWINSZ, &size) == 0) style.width = size.ws_col;
  const char* const no_colour = std::getenv("NO_COLOR");
  const char* const terminal = std::getenv("TERM");
  const bool is_dumb = terminal == nullptr || std::string_view(terminal) == "dumb";
  style.has_colour = (no_colour == nullptr || *no_colour == '\0') && !is_dumb;
  return style;
}

std::string verdict_timeline(const std::vector<VerdictEntry>& verdicts, std::size_t width) {
  std::vector<std::string> entries;
  for (const VerdictEntry& entry : verdicts) {
    // Every run begins so: it says nothing unless it stays.
    const bool is_start = &entry == verdicts.data() && verdicts.size() > 1 &&
                          entry.verdict == Verdict::kInhibited && entry.blame.empty();
    if (is_start) continue;
    entries.push_back(printable(fmt::format("{:.6g} {}", entry.t_s, verdict_text(entry))));
  }
  // The last ones say what it came to: those before them go first.
  std::string text;
  for (std::size_t shown = 0; shown < entries.size(); ++shown) {
    const std::size_t left_out = entries.size() - shown - 1;
    const std::string& entry = entries[left_out];
    const std::string longer = text.empty() ? entry : fmt::format("{}  {}", entry, text);
    const std::string head = left_out == 0 ? "" : fmt::format("({} more)  ", left_out);
    if (shown > 0 && head.size() + longer.size() > width) {
      return fmt::format("({} more)  {}", left_out + 1, text);
    }
    text = longer;
  }
  return shortened(text, width);
}

std::string suite_table(const std::vector<ScenarioOutcome>& outcomes, const TableStyle& style) {
  const Columns columns = columns_of(outcomes);
  const std::size_t timeline = timeline_columns(columns, style);
  std::string text =
      fmt::format("  {:<{}}  {:>{}} {:{}}  {:>{}}  {:>{}}  verdicts from, s\n", "scenario",
                  columns.name, "expect", columns.expect, "", columns.status, "cycles/s",
                  Columns::kSpeed, "wall, s", Columns::kWall);
  for (const ScenarioOutcome& outcome : outcomes) {
    std::string line = row_head(outcome, columns, style.has_colour);
    line += outcome.result ? verdict_timeline(outcome.result->history.verdicts(), timeline)
                           : shortened(printable(outcome.error), timeline);
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + "\n";
  }
  return text + complaints(outcomes) + sum(outcomes);
}

}  // namespace faultline

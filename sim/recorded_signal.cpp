#include "sim/recorded_signal.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/model/input_error.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

constexpr std::string_view kTime = "t_s";

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r";
  const std::size_t begin = text.find_first_not_of(kBlank);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlank) - begin + 1);
}

/// The cells of a line.
std::vector<std::string_view> cells_of(std::string_view line) {
  std::vector<std::string_view> cells;
  for (;;) {
    const std::size_t comma = line.find(',');
    cells.push_back(trimmed(line.substr(0, comma)));
    if (comma == std::string_view::npos) return cells;
    line.remove_prefix(comma + 1);
  }
}

/// The step that is usual: their median.
double usual_step(const std::vector<double>& times) {
  std::vector<double> steps;
  for (std::size_t row = 1; row < times.size(); ++row) {
    steps.push_back(times[row] - times[row - 1]);
  }
  const auto middle = steps.begin() + std::ssize(steps) / 2;
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

}  // namespace

RecordedSignal::RecordedSignal(std::string_view text, std::string source)
    : source_(std::move(source)) {
  std::vector<int> line_of;
  int number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = trimmed(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    ++number;
    if (line.empty() && text.empty()) break;
    if (number == 1) {
      read_header(line);
    } else {
      read_row(line, number);
      line_of.push_back(number);
    }
  }
  if (number == 0) throw InputError(source_, {1, 1}, "found nothing, expected a header with t_s");
  if (times_.size() < 2) {
    throw InputError(source_, {number, 1},
                     fmt::format("found {} rows, expected two at least", times_.size()));
  }
  refuse_gaps(line_of);
}

void RecordedSignal::read_header(std::string_view line) {
  const std::vector<std::string_view> cells = cells_of(line);
  bool has_time = false;
  for (std::size_t column = 0; column < cells.size(); ++column) {
    const std::string name(cells[column]);
    const auto refuse = [&](const std::string& text) {
      throw InputError(source_, {1, 1}, fmt::format("column {}: {}", column + 1, text));
    };
    if (name.empty()) refuse("found no name, expected one");
    if (std::find(names_.begin(), names_.end(), name) != names_.end() ||
        (name == kTime && has_time)) {
      refuse(fmt::format("found a second \"{}\", expected each name once", name));
    }
    if (name == kTime) {
      has_time = true;
      time_column_ = column;
    } else {
      names_.push_back(name);
    }
  }
  if (!has_time) {
    throw InputError(source_, {1, 1},
                     fmt::format("found the columns {}, expected one of them to be t_s, the time "
                                 "in seconds",
                                 fmt::join(names_, ", ")));
  }
  if (names_.empty()) {
    throw InputError(source_, {1, 1}, "found the column t_s alone, expected a signal beside it");
  }
}

void RecordedSignal::read_row(std::string_view line, int number) {
  const std::vector<std::string_view> cells = cells_of(line);
  const std::size_t expected = names_.size() + 1;
  if (cells.size() != expected) {
    throw InputError(source_, {number, 1},
                     line.empty() ? fmt::format("found an empty line, expected {} cells", expected)
                                  : fmt::format("found {} cells, expected {} as in the header",
                                                cells.size(), expected));
  }
  std::size_t signal = 0;
  for (std::size_t column = 0; column < cells.size(); ++column) {
    const std::string_view cell = cells[column];
    const bool is_time = column == time_column_;
    const std::string_view name = is_time ? kTime : std::string_view(names_[signal]);
    double value = 0.0;
    const auto [stop, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
    if (error != std::errc() || stop != cell.data() + cell.size() || !std::isfinite(value)) {
      throw InputError(source_, {number, 1},
                       fmt::format("{}: found {}, expected a finite number", name,
                                   cell.empty() ? "an empty cell" : fmt::format("\"{}\"", cell)));
    }
    if (!is_time) {
      values_.push_back(value);
      ++signal;
      continue;
    }
    if (!times_.empty() && value <= times_.back()) {
      throw InputError(
          source_, {number, 1},
          fmt::format("t_s: found {}, expected more than the {} before it", value, times_.back()));
    }
    times_.push_back(value);
  }
}

void RecordedSignal::refuse_gaps(const std::vector<int>& line_of) const {
  const double step = usual_step(times_);
  std::size_t usual_count = 0, gap = 0;
  for (std::size_t row = 1; row < times_.size(); ++row) {
    const double this_step = times_[row] - times_[row - 1];
    if (std::abs(this_step - step) <= kStepTolerance * step) ++usual_count;
    if (gap == 0 && this_step > kLongestStep * step) gap = row;
  }
  const auto regular = kRegularShare * static_cast<double>(times_.size() - 1);
  if (gap == 0 || static_cast<double>(usual_count) < regular) return;
  throw InputError(source_, {line_of[gap], 1},
                   fmt::format("t_s: found a gap from {} to {} s, expected a row every {:.6g} s as "
                               "elsewhere: fill it, or cut the record",
                               times_[gap - 1], times_[gap], step));
}

std::size_t RecordedSignal::index_of(std::string_view name) const {
  const auto found = std::find(names_.begin(), names_.end(), name);
  if (found != names_.end()) return static_cast<std::size_t>(found - names_.begin());
  const auto near = nearest_name(name, names_);
  throw InputError(source_, {1, 1},
                   fmt::format("found no column \"{}\", expected one (there are {}){}", name,
                               fmt::join(names_, ", "),
                               near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
}

double RecordedSignal::largest(std::size_t index) const noexcept {
  double largest = 0.0;
  for (std::size_t row = 0; row < times_.size(); ++row) {
    largest = std::max(largest, std::abs(cell(row, index)));
  }
  return largest;
}

std::size_t RecordedSignal::row_before(double t_s) const noexcept {
  // Where it would be if all steps were equal; mostly they are.
  const double share = (t_s - times_.front()) / length_s();
  const auto last = times_.size() - 1;
  const auto guess =
      std::min(last - 1, static_cast<std::size_t>(share * static_cast<double>(last)));
  for (const std::size_t row : {guess, guess + 1, guess - std::min<std::size_t>(guess, 1)}) {
    if (row <= last && times_[row] <= t_s && (row == last || t_s < times_[row + 1])) return row;
  }
  const auto after = std::upper_bound(times_.begin(), times_.end(), t_s);
  return static_cast<std::size_t>(after - times_.begin()) - (after == times_.begin() ? 0 : 1);
}

double RecordedSignal::value(std::size_t index, double since_s, Between between,
                             bool is_repeated) const noexcept {
  const std::size_t last = times_.size() - 1;
  const double last_step = times_[last] - times_[last - 1];
  const double period_s = length_s() + last_step;
  // Cycle times are multiples of a sample time in floating point: a nanosecond early is in time.
  constexpr double kSlack_s = 0.5e-9;
  double since = std::max(0.0, since_s + kSlack_s);
  if (is_repeated) since = std::fmod(since, period_s);
  const double t_s = times_.front() + since;
  const std::size_t row = t_s >= times_[last] ? last : row_before(t_s);
  if (row == last && !is_repeated) return cell(last, index);
  if (between == Between::kHold) return cell(row, index);
  const double step = row == last ? last_step : times_[row + 1] - times_[row];
  const double share = std::clamp((t_s - kSlack_s - times_[row]) / step, 0.0, 1.0);
  const double next = cell(row == last ? 0 : row + 1, index);
  return cell(row, index) + share * (next - cell(row, index));
}

}  // namespace faultline

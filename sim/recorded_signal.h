#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace faultline {

/// Signals over time, as a CSV file has them:
///
///   t_s,wind,u1
///   0.00,0.1,2
///   0.01,0.2,2.5
///
/// A header, one column "t_s" with the time in seconds, increasing from row to row, and a column of
/// finite numbers per signal. Commas separate, blanks around a cell do not count, lines may end in
/// CR LF.
class RecordedSignal {
 public:
  /// What it is between two rows.
  enum class Between {
    kLinear,  ///< on the straight line between them
    kHold,    ///< as in the row before
  };

  /// Reads the text of a CSV file; `source` is its name, for messages.
  /// @throws InputError with the line: no header, no column "t_s" or a second one, a column without
  ///   a name or with the name of another, fewer than two rows, a row with too few or too many
  ///   cells, an empty cell, a cell that is not a finite number, a time that does not increase, a
  ///   gap: a record whose steps are equal but for a few (kRegularShare) has one of more than
  ///   kLongestStep of them.
  RecordedSignal(std::string_view text, std::string source);

  /// Names of the signals, in the order of the columns.
  [[nodiscard]] const std::vector<std::string>& names() const noexcept { return names_; }
  /// Index of a signal. @throws InputError there is none (the nearest name is suggested).
  [[nodiscard]] std::size_t index_of(std::string_view name) const;
  /// From the first row to the last.
  [[nodiscard]] double length_s() const noexcept { return times_.back() - times_.front(); }
  /// Of the magnitudes of signal `index`.
  [[nodiscard]] double largest(std::size_t index) const noexcept;
  [[nodiscard]] const std::string& source() const noexcept { return source_; }

  /// Signal `index` at `since_s` after the first row. Behind the last row it stays there, or
  /// begins anew: the first row comes a step (the last one's) after the last. Real-time: neither
  /// allocates nor throws. Cost: constant in a record with equal steps, else of a bisection.
  [[nodiscard]] double value(std::size_t index, double since_s, Between between,
                             bool is_repeated) const noexcept;

  /// So many of the steps are equal, within kStepTolerance, in a record that is regular.
  static constexpr double kRegularShare = 0.9;
  /// Relative: times are written with some digits only.
  static constexpr double kStepTolerance = 0.01;
  /// In usual steps: a record that jitters by half a step lacks nothing.
  static constexpr double kLongestStep = 1.5;

 private:
  void read_header(std::string_view line);
  void read_row(std::string_view line, int number);
  void refuse_gaps(const std::vector<int>& line_of) const;
  /// Row at or before `t_s`. @pre t_s is within the record
  [[nodiscard]] std::size_t row_before(double t_s) const noexcept;
  [[nodiscard]] double cell(std::size_t row, std::size_t index) const noexcept {
    return values_[row * names_.size() + index];
  }

  std::string source_;
  std::vector<std::string> names_;
  std::size_t time_column_ = 0;
  std::vector<double> times_;
  std::vector<double> values_;  // row by row
};

}  // namespace faultline

#pragma once

#include <cstdint>
#include <map>
#include <vector>

namespace faultline {

/// Numbers first, first + 1, .. last.
struct NumberRange {
  std::int64_t first = 0;
  std::int64_t last = 0;

  friend bool operator==(const NumberRange&, const NumberRange&) = default;
};

/// A set of numbers of which most follow each other. Memory: one entry per gap.
class NumberRanges {
 public:
  /// @return false if some of them were there already. @pre 0 <= first <= last < 2^63 - 1
  bool add(std::int64_t first, std::int64_t last);
  bool add(std::int64_t number) { return add(number, number); }

  [[nodiscard]] bool is_empty() const noexcept { return last_of_.empty(); }
  /// @pre not empty
  [[nodiscard]] std::int64_t smallest() const noexcept { return last_of_.begin()->first; }
  [[nodiscard]] std::int64_t largest() const noexcept { return last_of_.rbegin()->second; }
  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }

  /// The numbers in [from, until) that are not there.
  [[nodiscard]] std::vector<NumberRange> gaps(std::int64_t from, std::int64_t until) const;

 private:
  std::map<std::int64_t, std::int64_t> last_of_;  ///< by their first
  std::uint64_t count_ = 0;
};

/// How many numbers these are.
[[nodiscard]] std::uint64_t count_of(const std::vector<NumberRange>& ranges) noexcept;

}  // namespace faultline

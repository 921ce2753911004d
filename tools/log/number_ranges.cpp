#include "tools/log/number_ranges.h"

#include <algorithm>
#include <iterator>

namespace faultline {

bool NumberRanges::add(std::int64_t first, std::int64_t last) {
  const auto wanted = static_cast<std::uint64_t>(last - first) + 1;
  // The usual case: on from the largest.
  if (!is_empty() && largest() + 1 == first) {
    last_of_.rbegin()->second = last;
    count_ += wanted;
    return true;
  }
  std::uint64_t known = 0;
  auto next = last_of_.upper_bound(first);
  if (next != last_of_.begin() && std::prev(next)->second >= first - 1) --next;
  NumberRange merged{first, last};
  while (next != last_of_.end() && next->first <= last + 1) {
    const std::int64_t overlap = std::min(next->second, last) - std::max(next->first, first) + 1;
    known += static_cast<std::uint64_t>(std::max<std::int64_t>(overlap, 0));
    merged.first = std::min(merged.first, next->first);
    merged.last = std::max(merged.last, next->second);
    next = last_of_.erase(next);
  }
  last_of_.insert(next, {merged.first, merged.last});
  count_ += wanted - known;
  return known == 0;
}

std::vector<NumberRange> NumberRanges::gaps(std::int64_t from, std::int64_t until) const {
  std::vector<NumberRange> gaps;
  for (const auto& [first, last] : last_of_) {
    if (first >= until) break;
    if (first > from) gaps.push_back({from, first - 1});
    from = std::max(from, last + 1);
  }
  if (from < until) gaps.push_back({from, until - 1});
  return gaps;
}

std::uint64_t count_of(const std::vector<NumberRange>& ranges) noexcept {
  std::uint64_t count = 0;
  for (const NumberRange& range : ranges) {
    count += static_cast<std::uint64_t>(range.last - range.first) + 1;
  }
  return count;
}

}  // namespace faultline

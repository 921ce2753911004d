#include "tools/can/frame_filter.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>

namespace faultline {
namespace {

constexpr std::size_t kExtendedDigits = 8;

struct Identifier {
  std::uint32_t value = 0;
  bool is_extended = false;
};

std::optional<Identifier> to_identifier(std::string_view text) {
  if (text.empty() || text.size() > kExtendedDigits) return std::nullopt;
  Identifier id;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), id.value, 16);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  id.is_extended = text.size() == kExtendedDigits || id.value > kMaxStandardId;
  if (id.value > kMaxExtendedId) return std::nullopt;
  return id;
}

/// `*` stands for any characters. Linear in the text for each star: no backtracking beyond the
/// last.
bool matches(std::string_view pattern, std::string_view text) {
  std::size_t p = 0, t = 0, star = std::string_view::npos, resume = 0;
  while (t < text.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      resume = t;
    } else if (p < pattern.size() && pattern[p] == text[t]) {
      ++p;
      ++t;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      t = ++resume;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', p) == std::string_view::npos;
}

}  // namespace

FrameFilter::FrameFilter(const std::vector<std::string>& filters, const DbcDatabase* dbc) {
  for (const std::string& filter : filters) {
    const std::size_t separator = filter.find_first_of("-/");
    const std::string_view text = filter;
    const auto first = to_identifier(text.substr(0, separator));
    if (first && separator == std::string::npos) {
      ranges_.push_back({first->is_extended, first->value, first->value});
      continue;
    }
    const auto second =
        first ? to_identifier(text.substr(separator + 1)) : std::optional<Identifier>();
    if (!second) {
      add_by_name(filter, dbc);
      continue;
    }
    const bool is_extended = first->is_extended || second->is_extended;
    if (filter[separator] == '-') {
      ranges_.push_back({is_extended, first->value, second->value});
    } else {
      const std::uint32_t bits = second->value;
      ranges_.push_back({is_extended, first->value & bits, first->value & bits, bits});
    }
  }
}

void FrameFilter::add_by_name(std::string_view pattern, const DbcDatabase* dbc) {
  const std::size_t count_before = ranges_.size();
  if (dbc != nullptr) {
    for (const DbcMessage& message : dbc->messages) {
      if (!matches(pattern, message.name)) continue;
      ranges_.push_back({message.is_extended, message.id, message.id});
    }
  }
  if (ranges_.size() > count_before) return;
  throw std::invalid_argument(fmt::format(
      "filter: found \"{}\", expected an identifier (110, 18FEF100), a range (100-1FF), "
      "a mask (100/7F0) or the name of a message{}",
      pattern, dbc == nullptr ? " (which needs --dbc)" : " of the DBC"));
}

bool FrameFilter::passes(const CanFrame& frame) const noexcept {
  if (ranges_.empty() || frame.is_error) return true;
  return std::any_of(ranges_.begin(), ranges_.end(), [&](const Range& range) {
    const std::uint32_t id = frame.id & range.bits;
    return frame.is_extended == range.is_extended && id >= range.first && id <= range.last;
  });
}

}  // namespace faultline

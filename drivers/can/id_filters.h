#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/can/can_bus.h"

namespace faultline {

/// Receive filters of a bus whose kernel has none: data and remote frames pass if their identifier
/// and format are listed, all if nothing is; error frames pass always.
class IdFilters {
 public:
  IdFilters() = default;
  explicit IdFilters(std::span<const IdFilter> filters) {
    keys_.reserve(filters.size());
    for (const IdFilter& filter : filters) keys_.push_back(key(filter.id, filter.is_extended));
    std::sort(keys_.begin(), keys_.end());
  }

  /// Does not allocate.
  [[nodiscard]] bool pass(const CanFrame& frame) const noexcept {
    return keys_.empty() || frame.is_error ||
           std::binary_search(keys_.begin(), keys_.end(), key(frame.id, frame.is_extended));
  }

 private:
  /// Identifier and format in one number.
  static std::uint32_t key(std::uint32_t id, bool is_extended) noexcept {
    return id | (is_extended ? 0x8000'0000u : 0u);
  }

  std::vector<std::uint32_t> keys_;  ///< sorted
};

}  // namespace faultline

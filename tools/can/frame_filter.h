#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/can/can_frame.h"
#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// Which frames a person wants to see: those that any of the filters lets through; without filters
/// all. Error frames always pass.
///
///   110        identifier, hexadecimal; up to 3 digits an 11-bit one, 8 digits a 29-bit one
///   100-1FF    identifiers from .. to
///   100/7F0    identifiers that agree with the first in the bits of the second
///   Sensors*   messages of the DBC by name, `*` for any characters
class FrameFilter {
 public:
  FrameFilter() = default;
  /// @param dbc for names of messages; nullptr: none.
  /// @throws std::invalid_argument an entry is none of these, or no message has such a name.
  FrameFilter(const std::vector<std::string>& filters, const DbcDatabase* dbc);

  [[nodiscard]] bool passes(const CanFrame& frame) const noexcept;

 private:
  struct Range {
    bool is_extended = false;
    std::uint32_t first = 0, last = 0;
    std::uint32_t bits = kMaxExtendedId;  ///< that are compared
  };
  void add_by_name(std::string_view pattern, const DbcDatabase* dbc);

  std::vector<Range> ranges_;
};

}  // namespace faultline

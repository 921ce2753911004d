#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "tools/lcm/log_event.h"
#include "tools/lcm/message_type.h"
#include "tools/lcm/run_parts.h"

namespace faultline {

/// What stands in a table; nothing where there is no value.
using Cell = std::variant<std::monostate, std::int64_t, double, std::string>;

/// What the values of a run's messages are called.
struct ChannelNames {
  std::vector<std::string> outputs, inputs;
  std::vector<std::string> residuals;  ///< rows of all filters
  std::vector<std::string> filters, faults, states;
};

/// As bank and plant of a run say; what these do not say is empty, and counted then ("y1", ..).
[[nodiscard]] ChannelNames names_of(const RunParts& parts);

/// Messages of one type as rows of a table: one row per message, of FAULTLINE_CAN one per frame.
class MessageTable {
 public:
  /// @param names must outlive it. @param first_utime where t_s is zero.
  /// @pre is_tabular(type)
  MessageTable(const MessageType& type, const ChannelNames& names, std::int64_t first_utime);

  /// RUN is no table: it carries files.
  [[nodiscard]] static bool is_tabular(const MessageType& type) noexcept;

  /// Hands the rows of a message to `write`.
  /// @return false if it cannot be decoded, or has other columns than the first.
  bool read(const LogEvent& event, const std::function<void(std::span<const Cell>)>& write);

  /// Known with the first message.
  [[nodiscard]] const std::vector<std::string>& columns() const noexcept { return columns_; }

 private:
  MessageType type_;
  const ChannelNames* names_;
  std::int64_t first_utime_;
  std::vector<std::string> columns_;
  std::vector<Cell> cells_;
};

}  // namespace faultline

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "tools/lcm/log_reader.h"
#include "tools/lcm/message_sink.h"

namespace faultline {

/// An event of a log, to be changed.
struct EditedEvent {
  std::uint64_t index = 0;  ///< among those of its channel
  std::string channel;
  std::int64_t utime = 0;
  std::vector<std::uint8_t> data;
};

/// Copies a log event by event; `edit` may change each, and drops it by returning false.
inline void edit_log(const std::filesystem::path& from, const std::filesystem::path& to,
                     const std::function<bool(EditedEvent&)>& edit) {
  LogReader log(from);
  const auto out = open_log(to);
  std::map<std::string, std::uint64_t> counts;
  while (const LogEvent* event = log.next()) {
    EditedEvent edited{.channel = std::string(event->channel),
                       .utime = event->utime,
                       .data = {event->data.begin(), event->data.end()}};
    edited.index = counts[edited.channel]++;
    if (edit(edited)) out->publish(edited.channel.c_str(), edited.utime, edited.data);
  }
  out->close();
}

}  // namespace faultline

#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include <lcm/lcm-cpp.hpp>

#include "tools/replay/message_layout.h"

namespace faultline {

/// First bytes of every event in an LCM log (lcm/eventlog.c).
inline constexpr std::string_view kLogMagic = "\xED\xA1\xDA\x01";

/// Reads the message of an event of a log, measured by its layout first. @return false if it is of
/// another type or damaged.
template <class Message>
[[nodiscard]] bool decode_event(const lcm::LogEvent& event, std::string_view layout,
                                Message& message) {
  constexpr std::size_t kFingerprintBytes = 8;
  const std::span bytes(static_cast<const std::uint8_t*>(event.data),
                        static_cast<std::size_t>(event.datalen));
  return bytes.size() >= kFingerprintBytes &&
         laid_out_size(layout, bytes.subspan(kFingerprintBytes)) &&
         message.decode(event.data, 0, event.datalen) >= 0;
}

}  // namespace faultline

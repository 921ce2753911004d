#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "tools/lcm/message_layout.h"

namespace faultline {

/// First bytes of every event in an LCM log (lcm/eventlog.c).
inline constexpr std::string_view kLogMagic = "\xED\xA1\xDA\x01";

/// One event of an LCM log. Views into its reader.
struct LogEvent {
  std::uint64_t offset = 0;  ///< of its first byte in the log
  std::int64_t number = 0;   ///< as its writer counted
  std::int64_t utime = 0;    ///< when it was published or logged, µs since 1970
  std::string_view channel;
  std::span<const std::uint8_t> data;   ///< the encoded message
  std::span<const std::uint8_t> bytes;  ///< the whole event, as it stands in the log
};

/// Decodes a message from outside, measured by its layout first. @return false if it is of another
/// type or damaged.
template <class Message>
[[nodiscard]] bool decode_message(std::span<const std::uint8_t> data, std::string_view layout,
                                  Message& message) {
  constexpr std::size_t kFingerprintBytes = 8;
  return data.size() >= kFingerprintBytes &&
         laid_out_size(layout, data.subspan(kFingerprintBytes)) &&
         message.decode(data.data(), 0, static_cast<int>(data.size())) >= 0;
}

}  // namespace faultline

#pragma once

#include <string>
#include <string_view>

#include <fmt/format.h>

#include "drivers/can/can_frame.h"
#include "tools/can/frame_decoder.h"

namespace faultline {

/// Appends the value of signal `index` of a decoded frame: the shortest text that reads back as the
/// same double (of a scaled signal as one within 2 ulp, which the decoding leaves open: 0.8097
/// rather than 0.8097000000000001); all digits where raw value, factor and offset are whole numbers
/// that a double could not hold. @pre the signal is present
void append_value(fmt::memory_buffer& out, const CanFrame& frame, const DecodedFrame& decoded,
                  std::size_t index);

/// "1436509052.249713": the receive time in seconds since 1970, to the microsecond.
void append_time(fmt::memory_buffer& out, Timestamp stamp);

/// Appends a frame as one JSON object and a newline:
///
///   {"time":1436509052.249713,"bus":"vcan0","id":272,"extended":false,"message":"Sensors1",
///    "signals":{"y1":1.5},"beyond_payload":["y2"],"not_a_number":["y3"]}
///
/// `message` is null where the DBC has none; the last two are there only when they hold anything.
/// Remote and error frames and FD say so: "remote":true, "error":true, "fd":true.
void append_json(fmt::memory_buffer& out, const CanFrame& frame, std::string_view bus,
                 const DecodedFrame& decoded);

/// Appends "Sensors1  y1=1.5 m  gear=2 (second)", or nothing if the DBC has no message for it.
void append_signals(fmt::memory_buffer& out, const CanFrame& frame, const DecodedFrame& decoded);

/// Appends "vcan0  110   [8]  10 27 00 F0", as candump shows a frame.
void append_frame(fmt::memory_buffer& out, const CanFrame& frame, std::string_view bus);

/// `text` as a JSON string, quotes included; what is not UTF-8 is replaced.
[[nodiscard]] std::string json_string(std::string_view text);

}  // namespace faultline

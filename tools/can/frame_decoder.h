#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "drivers/can/can_frame.h"
#include "drivers/dbc/dbc_database.h"
#include "drivers/dbc/message_codec.h"

namespace faultline {

/// What a DBC says of one frame. Views into the decoder, valid until its next `decode`.
struct DecodedFrame {
  const DbcMessage* message = nullptr;  ///< nullptr: the DBC has none for it
  std::span<const double> values;       ///< physical, as DbcMessage::signals; where kPresent
  std::span<const SignalPresence> presence;
};

/// Finds the message of a frame in a DBC and decodes all its signals. Of two messages with one
/// identifier the first counts. A message that the DBC marks as a J1939 parameter group
/// (VFrameFormat "J1939PG") is also found under other priorities, source and destination addresses.
class FrameDecoder {
 public:
  /// Keeps a reference to `dbc`.
  explicit FrameDecoder(const DbcDatabase& dbc);

  [[nodiscard]] DecodedFrame decode(const CanFrame& frame) noexcept;
  /// The message of `frame`, or nullptr. Error frames have none.
  [[nodiscard]] const DbcMessage* find_message(const CanFrame& frame) const noexcept;
  /// How `message`, one of the database's, is read and written.
  [[nodiscard]] const MessageCodec& codec_of(const DbcMessage& message) const noexcept;

 private:
  const DbcDatabase* dbc_;
  std::vector<MessageCodec> codecs_;                              ///< by message
  std::unordered_map<std::uint32_t, std::size_t> by_identifier_;  ///< bit 31: extended
  std::unordered_map<std::uint32_t, std::size_t> by_parameter_group_;
  std::vector<double> values_;
  std::vector<SignalPresence> presence_;
};

}  // namespace faultline

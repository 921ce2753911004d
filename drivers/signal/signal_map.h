#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/can/can_bus.h"
#include "drivers/can/can_frame.h"
#include "drivers/dbc/dbc_database.h"
#include "drivers/dbc/signal_codec.h"
#include "drivers/signal/message_integrity.h"
#include "drivers/signal/message_protection.h"

namespace faultline {

/// The DBC does not carry what the channels need. The message names the DBC with line and column
/// (of the nearest signal where one is missing), the channel, what was found and what was expected.
class SignalMapError : public std::runtime_error {
 public:
  explicit SignalMapError(const std::string& text, std::string mapped_channel = {})
      : std::runtime_error(text), mapped_channel_(std::move(mapped_channel)) {}
  /// The channel whose mapping asks for what is not there; empty if no mapping is to blame.
  [[nodiscard]] const std::string& mapped_channel() const noexcept { return mapped_channel_; }

 private:
  std::string mapped_channel_;
};

/// How a channel of the plant is found on the bus: channel = sign·scale·signal + offset.
struct ChannelMapping {
  std::string signal;  ///< "Message.Signal", or "Signal" where that is unique
  double scale = 1.0;  ///< with its sign
  double offset = 0.0;
};

/// One channel inside a message.
struct MappedSignal {
  std::size_t channel =
      0;  ///< index among the outputs (sensor messages) or inputs (command messages)
  SignalCodec codec;
  double scale = 1.0;
  double offset = 0.0;
};

/// One message of the bus that carries channels: what to send and what to read.
struct MappedMessage {
  std::string name;
  std::uint32_t id = 0;
  bool is_extended = false;
  std::uint8_t length = 0;
  bool is_fd = false;
  std::uint8_t bus = 0;  ///< where it lives (CanFrame::bus)
  std::vector<MappedSignal> channels;
  /// Role `cycle`: k mod 2^w (sensor messages), command counter mod 2^w (command messages), w >= 4.
  std::optional<SignalCodec> cycle;
  MessageProtection protection;  ///< alive counter and checksum, if it has them
  /// Cycles from one frame to the next: 1, or more for a sensor message that is slower than the
  /// cycle. Between its frames its channels hold their values.
  std::uint32_t cycles_per_frame = 1;

  [[nodiscard]] bool matches(const CanFrame& frame) const noexcept {
    return frame.id == id && frame.is_extended == is_extended && frame.bus == bus &&
           !frame.is_remote && !frame.is_error;
  }
  /// Fills `frame` with this message: its channels from `values` (all channels of the side, by
  /// index) and the low bits of `cycle_number`. What protects it a MessageProtector fills in
  /// afterwards, which counts the frames. Values that do not fit are clamped; NaN leaves the
  /// raw value 0.
  /// @return how many values did not fit or were NaN. @pre values.size() > every channel
  std::size_t encode(std::span<const double> values, std::uint32_t cycle_number,
                     CanFrame& frame) const noexcept;
  /// Reads this message's channels into `values` (by channel index).
  /// @return kPayloadTooShort if any signal is missing, kNotANumber if any is not finite; then no
  ///   value is written. @pre values.size() > every channel
  [[nodiscard]] CodecStatus decode(const CanFrame& frame, std::span<double> values) const noexcept;
};

/// What a node needs to send `messages`: a protector for each.
[[nodiscard]] std::vector<MessageProtector> protectors(const std::vector<MappedMessage>& messages);

/// The message by which the plant announces cycle k and the command that acts in it.
struct SyncMessage {
  std::string name;
  std::uint32_t id = 0;
  bool is_extended = false;
  std::uint8_t length = 0;
  bool is_fd = false;
  std::uint8_t bus = 0;
  SignalCodec cycle;                         ///< role `sync`: k, 32 bits
  std::optional<SignalCodec> command_cycle;  ///< role `command_cycle`: c_k, 32 bits
  MessageProtection protection;

  [[nodiscard]] bool matches(const CanFrame& frame) const noexcept {
    return frame.id == id && frame.is_extended == is_extended && frame.bus == bus &&
           !frame.is_remote && !frame.is_error;
  }
  void encode(std::uint32_t k, std::uint32_t c_k, CanFrame& frame) const noexcept;
};

/// c_k of a cycle in which no complete command has arrived yet: the inputs are zero (at the
/// operating point).
inline constexpr std::uint32_t kNoCommand = 0xFFFFFFFF;

/// Which frames carry which channels. Immutable after construction; shared by plant, controller and
/// diagnosis nodes, so that all three agree.
struct SignalMap {
  std::vector<std::string> output_names;
  std::vector<std::string> input_names;
  std::vector<double> output_resolution;  ///< physical size of one LSB, per output; 0 for floats
  std::vector<double> input_resolution;
  std::vector<MappedMessage> sensor_messages;
  std::vector<MappedMessage> command_messages;
  std::optional<SyncMessage> sync;

  /// Mapped messages are counted together: the sensors' first, then the commands', then SYNC.
  [[nodiscard]] std::size_t message_count() const noexcept {
    return sensor_messages.size() + command_messages.size() + (sync ? 1u : 0u);
  }
  /// @pre message < message_count()
  [[nodiscard]] const std::string& message_name(std::size_t message) const noexcept;
  [[nodiscard]] const MessageProtection& message_protection(std::size_t message) const noexcept;

  /// Identifiers of all mapped messages, for kernel filters.
  [[nodiscard]] std::vector<IdFilter> filters() const;
};

/// Finds every channel in the DBC. By default a channel's signal bears its name; `mappings` (by
/// channel name) overrides. What a signal is for, attribute `FaultlineRole` says: sync, cycle,
/// command_cycle; alive, crc and data_id_nibble, which protect a message (message_protection.h); ""
/// and "none" say nothing. Messages stand in the order of the DBC.
///
/// @throws SignalMapError
///   a channel has no signal (with the nearest names), or several, or one that another channel has;
///   a channel's signal is multiplexed, or lies beyond its message;
///   a message carries both sensors and commands, or channels and the role sync;
///   a role is unknown, given twice in a message, a float, or too narrow: sync and command_cycle
///   need 32 bits, cycle 4; command_cycle stands in another message than sync;
///   two mapped messages of one bus have one identifier;
///   the protection or bus of a mapped message is described wrongly: see compile_protection; a
///   channel or counter lies in the bits of its alive counter or checksum;
///   a mapping names no channel, or its scale is zero or a number of it is not finite.
[[nodiscard]] SignalMap make_signal_map(
    const DbcDatabase& dbc, const std::vector<std::string>& output_names,
    const std::vector<std::string>& input_names,
    const std::map<std::string, ChannelMapping, std::less<>>& mappings = {});

}  // namespace faultline

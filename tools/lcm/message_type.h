#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace faultline {

/// A type of message that a run publishes, each on a channel of its own.
struct MessageType {
  std::string_view channel;
  std::string_view name;    ///< "sample_t"
  std::string_view layout;  ///< message_layout.h
  std::int64_t fingerprint = 0;
  bool has_cycle = false;  ///< its third member is the cycle
};

/// All of them, in the order of docs/design.md.
[[nodiscard]] std::span<const MessageType> message_types() noexcept;

/// nullptr: a run publishes nothing on this channel.
[[nodiscard]] const MessageType* find_message_type(std::string_view channel) noexcept;

/// The int64_t of an encoded message that begins at byte `at`. @pre its 8 bytes are there
[[nodiscard]] std::int64_t big_endian_at(std::span<const std::uint8_t> data,
                                         std::size_t at) noexcept;

/// What all our messages begin with.
struct MessageHead {
  std::int64_t utime = 0;
  std::int64_t sequence = 0;
  std::int64_t cycle = -1;  ///< -1: it has none
};

enum class MessageStatus {
  kWhole,
  kOtherSchema,  ///< another fingerprint: another type, or ours in another version
  kDamaged,      ///< its bytes do not follow each other as the type's do, or its number is none
};

/// Reads the head of an encoded message that is measured whole; safe on any bytes.
[[nodiscard]] MessageStatus read_head(const MessageType& type, std::span<const std::uint8_t> data,
                                      MessageHead& head) noexcept;

}  // namespace faultline

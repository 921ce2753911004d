#pragma once

#include <cstdint>
#include <string_view>

#include "drivers/can/can_frame.h"
#include "drivers/dbc/dbc_database.h"
#include "drivers/signal/message_protection.h"

namespace faultline {

/// What the check of one frame found.
enum class IntegrityStatus : std::uint8_t {
  kOk,                 ///< or nothing to check
  kCounterGap,         ///< good, but frames before it were lost, or its sender began anew
  kCounterRepeated,    ///< the counter is the last good frame's: a duplicate, or a frozen sender
  kCounterOutOfRange,  ///< the counter is no number of its sequence (profile 1: 15)
  kWrongCrc,           ///< checksum or data id nibble
  kTooShort,           ///< the payload is shorter than the message
};

/// "ok", "counter gap", "counter repeated", "counter out of range", "wrong CRC", "too short".
[[nodiscard]] std::string_view integrity_status_name(IntegrityStatus status) noexcept;

/// True if the frame's values may be used: kOk and kCounterGap.
[[nodiscard]] constexpr bool is_usable(IntegrityStatus status) noexcept {
  return status == IntegrityStatus::kOk || status == IntegrityStatus::kCounterGap;
}

struct IntegrityResult {
  IntegrityStatus status = IntegrityStatus::kOk;
  std::uint64_t lost = 0;  ///< kCounterGap: frames missing since the last good one; 0: began anew

  [[nodiscard]] bool operator==(const IntegrityResult&) const = default;
};

/// Counters only grow (until `reset`), and stop at 2^64 - 1. Every frame is one of the first five,
/// or fine; a gap is no bad frame.
struct IntegrityCounters {
  std::uint64_t frames = 0;  ///< checked
  std::uint64_t wrong_crc = 0;
  std::uint64_t repeated = 0;
  std::uint64_t out_of_range = 0;
  std::uint64_t too_short = 0;
  std::uint64_t gaps = 0;
  std::uint64_t lost = 0;      ///< frames missing, over all gaps
  std::uint64_t restarts = 0;  ///< gaps in which a wide counter went back

  /// Frames not to be used.
  [[nodiscard]] std::uint64_t bad_frames() const noexcept {
    return wrong_crc + repeated + out_of_range + too_short;
  }
};

/// Receiver's side of one message's protection: follows the alive counter and checks the checksum.
///
/// With c the frame's counter, c' that of the last good frame, M the length of the sequence and b
/// the bad frames (wrong CRC, too short, out of range) since then, which counted too:
///
///   d = (c - c') mod M;  d = 0 repeated;  d <= 1 + b ok;  else a gap: d - 1 - b frames lost
///
/// and after b >= M - 1 bad frames nothing can be told: ok. The first good frame sets c', a
/// repeated one leaves it, so that a frozen counter is a repeat each time; after a gap c' = c.
/// A counter of kWideCounter or more numbers that went back (d > M/2) is a sender that began anew:
/// a gap in which nothing is known to be lost.
///
/// Does not allocate or throw after construction. Use from one thread. One object per message and
/// bus; copy it to begin with the same description.
class MessageIntegrity {
 public:
  static constexpr std::uint64_t kWideCounter = 65536;  ///< lost so often in a row: unlikely

  /// Checks nothing: every frame is kOk.
  MessageIntegrity() = default;
  explicit MessageIntegrity(const MessageProtection& protection) : protection_(protection) {}
  /// @throws ProtectionError as compile_protection.
  MessageIntegrity(const DbcDatabase& dbc, const DbcMessage& message)
      : protection_(compile_protection(dbc, message)) {}

  /// Checks the next frame of this message. @pre `frame` is one, with data
  IntegrityResult check(const CanFrame& frame) noexcept;
  /// Back to before the first frame, counters included.
  void reset() noexcept;

  [[nodiscard]] const MessageProtection& protection() const noexcept { return protection_; }
  [[nodiscard]] const IntegrityCounters& counters() const noexcept { return counters_; }

 private:
  [[nodiscard]] IntegrityResult follow(std::uint64_t count) noexcept;

  MessageProtection protection_;
  IntegrityCounters counters_;
  bool has_last_ = false;
  std::uint64_t last_ = 0;       ///< c'
  std::uint64_t bad_since_ = 0;  ///< b
};

/// Sender's side: fills in counter, data id nibble and checksum of one message, frame by frame. The
/// counter is the object's own and begins with 0.
class MessageProtector {
 public:
  MessageProtector() = default;
  explicit MessageProtector(const MessageProtection& protection) : protection_(protection) {}

  /// Call last, with the other signals filled in. Does nothing to a frame shorter than its message.
  void protect(CanFrame& frame) noexcept;

 private:
  MessageProtection protection_;
  std::uint64_t next_ = 0;
};

}  // namespace faultline

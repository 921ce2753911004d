#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

#include "drivers/can/can_frame.h"
#include "drivers/signal/signal_map.h"
#include "drivers/signal/signal_state.h"

namespace faultline {

/// Why a sample is not to be trusted, or how it was made. Bits; a sample is good iff it has none of
/// kBadSample.
enum SampleFlag : std::uint32_t {
  kSampleSensorMissing = 1u << 0,   ///< a sensor message that was due in the cycle never came
  kSampleCommandMissing = 1u << 1,  ///< command c_k is unknown (no SYNC) or incomplete
  kSampleRepeated = 1u << 2,        ///< a message of this cycle came twice; the first one counts
  kSampleLate = 1u << 3,            ///< since the last sample, a message of a closed cycle came
  kSampleGap = 1u << 4,             ///< no frame of this cycle came: the counter jumped over it
  kSampleShortPayload = 1u << 5,    ///< a message was shorter than its signals need
  kSampleChecksum = 1u << 6,        ///< a checksum or alive counter was wrong
  kSampleReset = 1u << 7,      ///< first sample after a restart or a long gap: forget everything
  kSampleBusOrder = 1u << 8,   ///< aligned by bus order (no SYNC or no c_k): a remark, not a fault
  kSampleNotFinite = 1u << 9,  ///< a float on the bus was NaN or infinite; its message is held
  /// An alive counter of this cycle jumped: frames before it were lost. A remark: the samples that
  /// lack those frames are the bad ones. Where the message has no cycle counter, so that nothing
  /// else tells, kSampleChecksum too.
  kSampleAliveGap = 1u << 10,
};
inline constexpr std::uint32_t kBadSample =
    kSampleSensorMissing | kSampleCommandMissing | kSampleRepeated | kSampleLate | kSampleGap |
    kSampleShortPayload | kSampleChecksum | kSampleReset | kSampleNotFinite;

/// What a message did that makes a sample bad.
enum class MessageFault : std::uint8_t {
  kNone,
  kMissing,
  kLate,
  kRepeated,           ///< came twice in a cycle
  kTooShort,           ///< payload shorter than its signals, or its checksum, need
  kNotFinite,          ///< a float that is NaN or infinite
  kWrongCrc,           ///< checksum
  kCounterRepeated,    ///< alive counter: a duplicate or a frozen sender
  kCounterOutOfRange,  ///< alive counter: no number of its sequence
  kCounterGap,         ///< alive counter: frames lost
};

/// "missing", "late", "came twice", "too short", "not a finite number", "wrong CRC", "counter
/// repeated", "counter out of range", "counter gap"; "none".
[[nodiscard]] std::string_view message_fault_name(MessageFault fault) noexcept;

/// The message that a bad sample is to be blamed on: the first, where there are several.
struct Blame {
  static constexpr std::size_t kNoMessage = std::numeric_limits<std::size_t>::max();

  /// Index as in SignalMap::message_name; kNoMessage: no single one (no frame of the cycle came).
  std::size_t message = kNoMessage;
  MessageFault fault = MessageFault::kNone;

  [[nodiscard]] bool operator==(const Blame&) const = default;
};

/// Age of a value that never came.
inline constexpr std::uint32_t kNeverCame = std::numeric_limits<std::uint32_t>::max();

/// One sample (y_k, u_k): outputs measured at cycle k, inputs acting over [t_k, t_k+1).
/// Views into the sampler, valid until its next call.
struct Sample {
  std::uint32_t cycle = 0;  ///< k
  /// c_k; kNoCommand before the first command, where it is unknown, and in bus order.
  std::uint32_t command_cycle = kNoCommand;
  std::uint32_t flags = 0;                   ///< SampleFlag bits
  Timestamp stamp{};                         ///< receive time of the frame that closed it
  Blame blame;                               ///< of a bad sample; none after a reset
  std::span<const double> y;                 ///< outputs; a missing one holds its last value
  std::span<const double> u;                 ///< inputs; a missing one holds its last value
  std::span<const std::uint8_t> y_is_fresh;  ///< per output: 1 measured in this cycle, 0 held
  /// Per input: 1 the value acting in this cycle is known, 0 held. In bus order: 1 received since
  /// the sample before.
  std::span<const std::uint8_t> u_is_fresh;
  /// Per output and input: samples since the value was fresh, 0 if it is; kNeverCame. Counted, not
  /// timed: what is decided stays a function of the frames.
  std::span<const std::uint32_t> y_age;
  std::span<const std::uint32_t> u_age;
  /// kFresh with age 0. A held value is kCrcError or kCounterError if a frame of its message was
  /// refused for that within the last kRefusalCycles samples, else kNeverSeen or kStale.
  std::span<const SignalState> y_state;
  std::span<const SignalState> u_state;
  [[nodiscard]] bool is_good() const noexcept { return (flags & kBadSample) == 0; }
};

/// Samples, in the order they close, for which a refused frame explains that its message is
/// missing: its own, and the one before it, which may still be open when the frame comes.
inline constexpr std::uint8_t kRefusalCycles = 2;

}  // namespace faultline

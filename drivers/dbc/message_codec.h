#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// What a decode found of one signal.
enum class SignalPresence : std::uint8_t {
  kPresent,
  kNotSelected,    ///< the multiplexer selects others
  kBeyondPayload,  ///< it lies (partly) beyond the payload
  kNotANumber,     ///< a float that is NaN or infinite
  kNotCodable,     ///< the DBC describes it so that it has no value: see MessageCodec
};

/// What an encode does with a value that the signal's bits cannot hold.
enum class OutOfRange {
  kClamp,   ///< writes the nearest that fits
  kRefuse,  ///< writes nothing of the message
};

/// All signals of a message compiled for reading and writing payloads in one call, bounds-checked
/// by the payload that is really there. Neither `decode` nor `encode` allocates or throws.
///
///   physical = raw·factor + offset      (the double nearest to the decimal result of the DBC text)
///
/// Signals stand as in DbcMessage::signals. A signal that has no value (zero factor, no bits or
/// more than 64, a float that has not 32 or 64 bits, beyond 64 bytes) does not keep the others from
/// being read: it is kNotCodable in every frame.
class MessageCodec {
 public:
  MessageCodec() = default;
  explicit MessageCodec(const DbcMessage& message);

  [[nodiscard]] std::size_t signal_count() const noexcept;

  /// Physical values of all signals that `payload` holds; other values stay as they were.
  /// @return how many are kPresent. @pre values.size() and presence.size() >= signal_count()
  std::size_t decode(std::span<const std::uint8_t> payload, std::span<double> values,
                     std::span<SignalPresence> presence) const noexcept;

  /// Writes those signals of `values` that their multiplexers, also from `values`, select; the
  /// payload's other bits stay. NaN leaves a signal's bits as they are.
  /// @return how many values did not fit (or were NaN, or lie beyond the payload); with kRefuse
  ///   nothing is written if any did not. @pre values.size() >= signal_count()
  std::size_t encode(std::span<const double> values, std::span<std::uint8_t> payload,
                     OutOfRange out_of_range = OutOfRange::kClamp) const noexcept;
};

}  // namespace faultline

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/dbc/compiled_signal.h"
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
/// by the payload that is really there. Neither `decode` nor `encode` allocates or throws; both may
/// be called from several threads at once.
///
///   physical = raw·factor + offset      (factor and offset: the decimal numbers of the DBC text)
///
/// right to 2 ulp, also where both terms nearly cancel. What `decode` gave `encode` turns into the
/// same bits, for raw values of up to 53 bits; see SignalCodec for more bits.
///
/// Signals stand as in DbcMessage::signals. A signal that has no value (zero factor, no bits or
/// more than 64, a float that has not 32 or 64 bits, beyond 64 bytes, a circle of multiplexers)
/// does not keep the others from being read: it is kNotCodable in every frame, and `encode` ignores
/// it. `minimum` and `maximum` are not enforced: they describe, they do not limit.
class MessageCodec {
 public:
  MessageCodec() = default;
  explicit MessageCodec(const DbcMessage& message);

  [[nodiscard]] std::size_t signal_count() const noexcept { return signals_.size(); }

  /// Physical values of all signals that `payload` holds; other values stay as they were. Of a
  /// signal whose multiplexer lies beyond the payload nothing can be told: kBeyondPayload.
  /// @return how many are kPresent. @pre values.size() and presence.size() >= signal_count()
  std::size_t decode(std::span<const std::uint8_t> payload, std::span<double> values,
                     std::span<SignalPresence> presence) const noexcept;

  /// Writes those signals of `values` that their multiplexers, also from `values`, select; the
  /// payload's other bits stay. NaN leaves a signal's bits as they are; a multiplexer that is NaN
  /// selects by the bits that stand in the payload.
  /// @return how many values did not fit (or were NaN, or lie beyond the payload); with kRefuse
  ///   nothing is written if any did not. @pre values.size() >= signal_count()
  std::size_t encode(std::span<const double> values, std::span<std::uint8_t> payload,
                     OutOfRange out_of_range = OutOfRange::kClamp) const noexcept;

 private:
  /// One signal; without bits (`bit_count` 0) if its layout has none.
  struct Signal {
    CompiledSignal bits;
    bool is_codable = false;
    std::int32_t multiplexer = DbcSignal::kAlwaysPresent;
    std::uint32_t first_range = 0;  ///< in ranges_
    std::uint32_t range_count = 0;
  };

  static constexpr std::size_t kLanes = 4;

  /// Four signals as `decode` meets them mostly: integers of up to 51 bits within eight bytes,
  /// always present. Their values come at once and without a branch from words of eight bytes.
  struct alignas(32) Steps {
    std::array<double, kLanes> factor{}, offset{}, factor_rest{}, offset_rest{};
    std::array<std::uint64_t, kLanes> swap{};   ///< all ones if big-endian
    std::array<std::uint64_t, kLanes> left{};   ///< shift: its highest bit to the word's top
    std::array<std::uint64_t, kLanes> right{};  ///< shift: then its lowest bit down
    std::array<std::uint64_t, kLanes> sign_bit{};
    std::array<std::uint32_t, kLanes> signal{};     ///< where its value goes
    std::array<std::uint8_t, kLanes> first_byte{};  ///< of the word
    std::uint8_t count = 0;                         ///< the last of a message may have fewer
  };

  void compile_steps();
  [[nodiscard]] bool is_selected_by(const Signal& signal, std::uint64_t value) const noexcept;
  /// @return kPresent if its multiplexers select it
  [[nodiscard]] SignalPresence selection(const Signal& signal,
                                         std::span<const std::uint8_t> payload) const noexcept;
  [[nodiscard]] bool is_selected(const Signal& signal, std::span<const double> values,
                                 std::span<const std::uint8_t> payload) const noexcept;
  SignalPresence decode_signal(const Signal& signal, std::span<const std::uint8_t> payload,
                               double& value) const noexcept;
  /// As `decode`, for payloads and messages that are not as usual.
  [[gnu::noinline]] std::size_t decode_any(std::span<const std::uint8_t> payload,
                                           std::span<double> values,
                                           std::span<SignalPresence> presence) const noexcept;

  std::vector<Signal> signals_;
  std::vector<DbcMultiplexRange> ranges_;
  std::vector<Steps> steps_;
  std::vector<std::uint32_t> others_;  ///< signals that are no step
  std::size_t step_count_ = 0;
  std::size_t step_bytes_needed_ = 0;  ///< of the payload for all steps
  bool is_one_word_ = false;           ///< all signals are steps within the first eight bytes
};

}  // namespace faultline

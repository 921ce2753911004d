#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>
#include <string_view>

#include "drivers/dbc/dbc_database.h"
#include "drivers/dbc/signal_codec.h"

namespace faultline {

// What the DBC says of a message's protection (docs/can_integrity.md):
//
//   signal   FaultlineRole        "alive": the counter; "crc": the checksum; "data_id_nibble"
//   message  FaultlineProtection  one of the names below; without it there may be a counter alone
//   message  FaultlineDataId      data id of profiles 1 and 5
//   message  FaultlineDataIdList  data ids of profile 2: 16 bytes as 32 hexadecimal digits
//   message  FaultlineBus         the bus it lives on (CanFrame::bus); default 0
inline constexpr std::string_view kRoleAttribute = "FaultlineRole";
inline constexpr std::string_view kProtectionAttribute = "FaultlineProtection";
inline constexpr std::string_view kDataIdAttribute = "FaultlineDataId";
inline constexpr std::string_view kDataIdListAttribute = "FaultlineDataIdList";
inline constexpr std::string_view kBusAttribute = "FaultlineBus";

/// What a signal is for (FaultlineRole). "" and "none": kNone.
enum class SignalRole { kNone, kSync, kCycle, kCommandCycle, kAlive, kCrc, kDataIdNibble };

/// How a message is checksummed (FaultlineProtection).
enum class ProtectionProfile : std::uint8_t {
  kNone,     ///< "none", "": no checksum
  kJ1850,    ///< "J1850": CRC-8 SAE J1850 over the other bytes of the message
  kE2eP01A,  ///< "E2E_P01A": AUTOSAR profile 1, both bytes of the data id in every CRC
  kE2eP01B,  ///< "E2E_P01B": profile 1, its low and high byte by turns
  kE2eP01C,  ///< "E2E_P01C": profile 1, low byte in the CRC, high nibble sent
  kE2eP02,   ///< "E2E_P02": profile 2, a list of data ids
  kE2eP05,   ///< "E2E_P05": profile 5, CRC-16
};
/// The name as in the DBC.
[[nodiscard]] std::string_view protection_profile_name(ProtectionProfile profile) noexcept;

/// A message's protection is described wrongly. The message names the DBC with line and column, the
/// message or signal, what was found and what was expected.
class ProtectionError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One message's alive counter and checksum, compiled from the DBC for reading and writing
/// payloads. Immutable plain data; copying does not allocate. A default one protects nothing.
struct MessageProtection {
  ProtectionProfile profile = ProtectionProfile::kNone;
  std::uint8_t length = 0;  ///< payload bytes that the checksum covers: the message's
  std::optional<SignalCodec> alive;
  /// The counter runs 0 .. last, then 0: 2^bits - 1, or the signal's maximum where that is less and
  /// its minimum is 0; 14 for profile 1.
  std::uint64_t last_count = 0;
  std::uint8_t crc_byte = 0;                  ///< first byte of the checksum
  std::uint16_t data_id = 0;                  ///< profiles 1 and 5
  std::array<std::uint8_t, 16> data_ids{};    ///< profile 2, by counter
  std::optional<SignalCodec> data_id_nibble;  ///< profile 1C

  [[nodiscard]] bool has_counter() const noexcept { return alive.has_value(); }
  [[nodiscard]] bool has_crc() const noexcept { return profile != ProtectionProfile::kNone; }
  [[nodiscard]] bool is_none() const noexcept { return !has_counter() && !has_crc(); }

  /// Checksum (and data id nibble) as they should be. @pre payload.size() >= length
  [[nodiscard]] bool is_crc_right(std::span<const std::uint8_t> payload) const noexcept;
  /// The counter's raw value. @pre has_counter(), payload.size() >= length
  [[nodiscard]] std::uint64_t count(std::span<const std::uint8_t> payload) const noexcept;
  /// Writes counter, data id nibble and checksum, those that there are.
  /// @pre payload.size() >= length, counter <= last_count
  void write(std::span<std::uint8_t> payload, std::uint64_t counter) const noexcept;

 private:
  [[nodiscard]] std::uint16_t checksum(std::span<const std::uint8_t> payload) const noexcept;
};

/// True if two signals of one message share a bit of the first 64 bytes.
[[nodiscard]] bool overlap(const DbcSignal& a, const DbcSignal& b) noexcept;

/// What `signal` is for. @throws ProtectionError unknown role, or one that is no text.
[[nodiscard]] SignalRole role_of(const DbcDatabase& dbc, const DbcSignal& signal);

/// Index of the bus `message` lives on; nothing if the DBC does not say.
/// @throws ProtectionError FaultlineBus is no integer of 0 .. 255.
[[nodiscard]] std::optional<std::uint8_t> bus_of(const DbcDatabase& dbc, const DbcMessage& message);

/// Compiles what the DBC says of `message`, a message of `dbc`.
/// @throws ProtectionError
///   an unknown profile; a role twice; a profile without its crc, alive (but J1850) or
///   data_id_nibble signal, or a crc or data_id_nibble signal without its profile;
///   a crc signal that does not fill its bytes, or is no integer of 8 bits (profile 5: 16, Intel);
///   a counter that is a float, or has not the bits of its profile (1, 2: 4; 5: 8);
///   a signal of these roles that is multiplexed or lies beyond its message, or overlaps another;
///   a data id missing, out of range or where there can be none; a list that has not 16 bytes;
///   a message of more than 64 bytes.
[[nodiscard]] MessageProtection compile_protection(const DbcDatabase& dbc,
                                                   const DbcMessage& message);

}  // namespace faultline

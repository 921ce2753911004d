#include "drivers/signal/message_protection.h"

#include <algorithm>
#include <bitset>
#include <charconv>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "drivers/can/can_frame.h"
#include "drivers/signal/crc.h"
#include "drivers/signal/e2e.h"

namespace faultline {
namespace {

constexpr std::uint64_t kLastCountP01 = 14;        // 15 is reserved
constexpr std::int64_t kLargestNibbleId = 0x0FFF;  // profile 1C sends one nibble of the high byte
constexpr std::int64_t kLargestId = 0xFFFF;

constexpr std::array<std::pair<std::string_view, ProtectionProfile>, 8> kProfiles{{
    {"none", ProtectionProfile::kNone},
    {"", ProtectionProfile::kNone},
    {"J1850", ProtectionProfile::kJ1850},
    {"E2E_P01A", ProtectionProfile::kE2eP01A},
    {"E2E_P01B", ProtectionProfile::kE2eP01B},
    {"E2E_P01C", ProtectionProfile::kE2eP01C},
    {"E2E_P02", ProtectionProfile::kE2eP02},
    {"E2E_P05", ProtectionProfile::kE2eP05},
}};

constexpr std::array<std::pair<std::string_view, SignalRole>, 8> kRoles{{
    {"", SignalRole::kNone},
    {"none", SignalRole::kNone},
    {"sync", SignalRole::kSync},
    {"cycle", SignalRole::kCycle},
    {"command_cycle", SignalRole::kCommandCycle},
    {"alive", SignalRole::kAlive},
    {"crc", SignalRole::kCrc},
    {"data_id_nibble", SignalRole::kDataIdNibble},
}};

[[noreturn]] void fail(const DbcDatabase& dbc, DbcPosition position, const std::string& text) {
  throw ProtectionError(
      fmt::format("{}:{}:{}: {}", dbc.source, position.line, position.column, text));
}

/// The whole number an attribute holds; nothing if it holds none.
std::optional<std::int64_t> integer_of(const DbcAttributeValue& value) {
  if (const auto* const integer = std::get_if<std::int64_t>(&value)) return *integer;
  const auto* const number = std::get_if<double>(&value);
  constexpr double kExact = 0x1p53;
  if (number == nullptr || std::trunc(*number) != *number || std::abs(*number) > kExact) {
    return std::nullopt;
  }
  return static_cast<std::int64_t>(*number);
}

std::string describe(const DbcAttributeValue& value) {
  if (const auto* const text = std::get_if<std::string>(&value)) {
    return fmt::format("\"{}\"", *text);
  }
  if (const auto* const number = std::get_if<double>(&value)) return fmt::format("{}", *number);
  return fmt::format("{}", std::get<std::int64_t>(value));
}

bool is_float(const DbcSignal& signal) noexcept {
  return signal.type == SignalType::kFloat32 || signal.type == SignalType::kFloat64;
}

bool is_profile_1(ProtectionProfile profile) noexcept {
  return profile == ProtectionProfile::kE2eP01A || profile == ProtectionProfile::kE2eP01B ||
         profile == ProtectionProfile::kE2eP01C;
}

/// Bits of the payload, counted as the DBC counts them; those beyond 64 bytes are left out.
std::bitset<8 * kMaxPayload> bits_of(const DbcSignal& signal) noexcept {
  std::bitset<8 * kMaxPayload> bits;
  std::size_t bit = signal.start_bit;
  for (std::uint16_t n = 0; n < signal.bit_count; ++n) {
    if (bit < bits.size()) bits.set(bit);
    const bool is_last_of_byte = bit % 8 == 0;
    if (signal.byte_order == ByteOrder::kLittleEndian) {
      ++bit;
    } else {
      bit = is_last_of_byte ? bit + 15 : bit - 1;
    }
  }
  return bits;
}

/// Compiles one message; use once.
class ProtectionBuilder {
 public:
  ProtectionBuilder(const DbcDatabase& dbc, const DbcMessage& message)
      : dbc_(dbc), message_(message) {}

  MessageProtection build() {
    result_.profile = find_profile();
    find_signals();
    require_signals();
    if (result_.profile != ProtectionProfile::kNone || alive_ != nullptr) {
      require_length();
      require_distinct_bits();
      set_alive();
      set_crc();
      set_nibble();
    }
    set_data_id();
    set_data_id_list();
    return result_;
  }

 private:
  [[nodiscard]] std::string name_of(const DbcSignal& signal) const {
    return message_.name + "." + signal.name;
  }
  [[nodiscard]] ProtectionProfile find_profile() const;
  void find_signals();
  void take(const DbcSignal*& place, const DbcSignal& signal, std::string_view role) const;
  void require_signals() const;
  void require_one(const DbcSignal* signal, bool is_due, std::string_view role) const;
  void require_length();
  void require_distinct_bits() const;
  [[nodiscard]] SignalCodec codec_of(const DbcSignal& signal, std::string_view role,
                                     std::optional<std::uint16_t> bits) const;
  void set_alive();
  void set_crc();
  void set_nibble();
  void set_data_id();
  void set_data_id_list();

  const DbcDatabase& dbc_;
  const DbcMessage& message_;
  MessageProtection result_;
  const DbcSignal* alive_ = nullptr;
  const DbcSignal* crc_ = nullptr;
  const DbcSignal* nibble_ = nullptr;
};

ProtectionProfile ProtectionBuilder::find_profile() const {
  const DbcAttributeValue* const value = dbc_.attribute_of(message_, kProtectionAttribute);
  if (value == nullptr) return ProtectionProfile::kNone;
  const auto* const name = std::get_if<std::string>(value);
  const auto found = std::find_if(kProfiles.begin(), kProfiles.end(), [&](const auto& profile) {
    return name != nullptr && profile.first == *name;
  });
  if (found != kProfiles.end()) return found->second;
  std::vector<std::string_view> names;
  for (const auto& [profile_name, profile] : kProfiles) {
    if (!profile_name.empty()) names.push_back(profile_name);
  }
  fail(dbc_, message_.position,
       fmt::format("message {}: found {} {}, expected one of \"{}\"", message_.name,
                   kProtectionAttribute, describe(*value), fmt::join(names, "\", \"")));
}

void ProtectionBuilder::find_signals() {
  for (const DbcSignal& signal : message_.signals) {
    switch (role_of(dbc_, signal)) {
      case SignalRole::kAlive:
        take(alive_, signal, "alive");
        break;
      case SignalRole::kCrc:
        take(crc_, signal, "crc");
        break;
      case SignalRole::kDataIdNibble:
        take(nibble_, signal, "data_id_nibble");
        break;
      case SignalRole::kNone:
      case SignalRole::kSync:
      case SignalRole::kCycle:
      case SignalRole::kCommandCycle:
        break;
    }
  }
}

void ProtectionBuilder::take(const DbcSignal*& place, const DbcSignal& signal,
                             std::string_view role) const {
  if (place != nullptr) {
    fail(dbc_, signal.position,
         fmt::format("message {} has two signals of role {}, expected one", message_.name, role));
  }
  place = &signal;
}

void ProtectionBuilder::require_signals() const {
  const ProtectionProfile profile = result_.profile;
  const bool is_e2e = profile != ProtectionProfile::kNone && profile != ProtectionProfile::kJ1850;
  require_one(crc_, profile != ProtectionProfile::kNone, "crc");
  if (is_e2e) require_one(alive_, true, "alive");
  require_one(nibble_, profile == ProtectionProfile::kE2eP01C, "data_id_nibble");
}

void ProtectionBuilder::require_one(const DbcSignal* signal, bool is_due,
                                    std::string_view role) const {
  if ((signal != nullptr) == is_due) return;
  if (is_due) {
    fail(dbc_, message_.position,
         fmt::format("message {}: protection {} needs a signal of role {}, found none",
                     message_.name, protection_profile_name(result_.profile), role));
  }
  fail(
      dbc_, signal->position,
      fmt::format("signal {} has the role {}, and its message {} {}, expected {}", name_of(*signal),
                  role, kProtectionAttribute, protection_profile_name(result_.profile),
                  role == "crc" ? "one that says how it is made" : "E2E_P01C"));
}

void ProtectionBuilder::require_length() {
  if (message_.length > kMaxPayload) {
    fail(dbc_, message_.position,
         fmt::format("message {} has {} bytes, expected up to {} in one that is protected",
                     message_.name, message_.length, kMaxPayload));
  }
  result_.length = static_cast<std::uint8_t>(message_.length);
}

SignalCodec ProtectionBuilder::codec_of(const DbcSignal& signal, std::string_view role,
                                        std::optional<std::uint16_t> bits) const {
  if (is_float(signal)) {
    fail(dbc_, signal.position,
         fmt::format("role {}: signal {} is a float, expected an integer", role, name_of(signal)));
  }
  if (bits && signal.bit_count != *bits) {
    fail(dbc_, signal.position,
         fmt::format("role {}: signal {} has {} bits, expected {} with {}", role, name_of(signal),
                     signal.bit_count, *bits, protection_profile_name(result_.profile)));
  }
  try {
    return SignalCodec(signal);
  } catch (const std::invalid_argument& error) {
    fail(dbc_, signal.position, fmt::format("role {}: {}", role, error.what()));
  }
}

/// Also that they are there at all: in every frame, and within the message.
void ProtectionBuilder::require_distinct_bits() const {
  std::vector<const DbcSignal*> before;
  for (const DbcSignal* const signal : {crc_, alive_, nibble_}) {
    if (signal == nullptr) continue;
    if (signal->multiplexer != DbcSignal::kAlwaysPresent) {
      fail(dbc_, signal->position,
           fmt::format("signal {} is multiplexed, expected one that every frame carries",
                       name_of(*signal)));
    }
    if (signal->bit_count < 1 || payload_bytes_needed(*signal) > message_.length) {
      fail(dbc_, signal->position,
           fmt::format("signal {} of {} bits needs {} bytes, its message has {}", name_of(*signal),
                       signal->bit_count, signal->bit_count < 1 ? 0 : payload_bytes_needed(*signal),
                       message_.length));
    }
    for (const DbcSignal* const other : before) {
      if (!overlap(*signal, *other)) continue;
      fail(dbc_, signal->position,
           fmt::format("signal {} overlaps {}", name_of(*signal), name_of(*other)));
    }
    before.push_back(signal);
  }
}

void ProtectionBuilder::set_alive() {
  if (alive_ == nullptr) return;
  std::optional<std::uint16_t> bits;
  if (is_profile_1(result_.profile) || result_.profile == ProtectionProfile::kE2eP02) bits = 4;
  if (result_.profile == ProtectionProfile::kE2eP05) bits = 8;
  result_.alive = codec_of(*alive_, "alive", bits);
  result_.last_count = std::numeric_limits<std::uint64_t>::max() >> (64 - alive_->bit_count);
  if (is_profile_1(result_.profile)) {
    result_.last_count = kLastCountP01;
  } else if (!bits && alive_->factor == 1.0 && alive_->offset == 0.0 && alive_->minimum == 0.0 &&
             alive_->maximum >= 1.0 && alive_->maximum < static_cast<double>(result_.last_count)) {
    result_.last_count = static_cast<std::uint64_t>(alive_->maximum);
  }
}

void ProtectionBuilder::set_crc() {
  if (crc_ == nullptr) return;
  const bool is_word = result_.profile == ProtectionProfile::kE2eP05;
  static_cast<void>(codec_of(*crc_, "crc", is_word ? 16 : 8));
  if (is_word && crc_->byte_order != ByteOrder::kLittleEndian) {
    fail(dbc_, crc_->position,
         fmt::format("role crc: signal {} is big-endian, expected little-endian (@1) with {}",
                     name_of(*crc_), protection_profile_name(result_.profile)));
  }
  const bool is_intel = crc_->byte_order == ByteOrder::kLittleEndian;
  if (crc_->start_bit % 8 != (is_intel ? 0 : 7)) {
    fail(dbc_, crc_->position,
         fmt::format("role crc: signal {} begins at bit {} of a byte, expected it to fill whole "
                     "bytes",
                     name_of(*crc_), crc_->start_bit % 8));
  }
  result_.crc_byte = static_cast<std::uint8_t>(crc_->start_bit / 8);
}

void ProtectionBuilder::set_nibble() {
  if (nibble_ != nullptr) result_.data_id_nibble = codec_of(*nibble_, "data_id_nibble", 4);
}

/// An id must be the message's own: one by default would protect nothing from being mixed up.
void ProtectionBuilder::set_data_id() {
  const bool is_due =
      is_profile_1(result_.profile) || result_.profile == ProtectionProfile::kE2eP05;
  const auto found = message_.attributes.find(kDataIdAttribute);
  if (found == message_.attributes.end()) {
    if (!is_due) return;
    fail(dbc_, message_.position,
         fmt::format("message {}: protection {} needs the attribute {}, found none of its own",
                     message_.name, protection_profile_name(result_.profile), kDataIdAttribute));
  }
  if (!is_due) {
    fail(dbc_, message_.position,
         fmt::format("message {}: found {} {}, expected none with {} {}", message_.name,
                     kDataIdAttribute, describe(found->second), kProtectionAttribute,
                     protection_profile_name(result_.profile)));
  }
  const std::int64_t largest =
      result_.profile == ProtectionProfile::kE2eP01C ? kLargestNibbleId : kLargestId;
  const std::optional<std::int64_t> id = integer_of(found->second);
  if (!id || *id < 0 || *id > largest) {
    fail(dbc_, message_.position,
         fmt::format("message {}: found {} {}, expected an integer of 0 .. {}", message_.name,
                     kDataIdAttribute, describe(found->second), largest));
  }
  result_.data_id = static_cast<std::uint16_t>(*id);
}

void ProtectionBuilder::set_data_id_list() {
  const bool is_due = result_.profile == ProtectionProfile::kE2eP02;
  const auto found = message_.attributes.find(kDataIdListAttribute);
  const auto refuse = [&](std::string_view what) {
    fail(dbc_, message_.position,
         fmt::format("message {}: found {} {}, expected {}", message_.name, kDataIdListAttribute,
                     found == message_.attributes.end() ? "missing" : describe(found->second),
                     what));
  };
  if (found == message_.attributes.end() && !is_due) return;
  if (!is_due) refuse("none without E2E_P02");
  constexpr std::string_view kExpected = "16 bytes as 32 hexadecimal digits";
  const auto* const text =
      found == message_.attributes.end() ? nullptr : std::get_if<std::string>(&found->second);
  if (text == nullptr || text->size() != 2 * result_.data_ids.size()) refuse(kExpected);
  for (std::size_t n = 0; n < result_.data_ids.size(); ++n) {
    const char* const first = text->data() + 2 * n;
    const auto [end, error] = std::from_chars(first, first + 2, result_.data_ids[n], 16);
    if (error != std::errc{} || end != first + 2) refuse(kExpected);
  }
}

}  // namespace

std::string_view protection_profile_name(ProtectionProfile profile) noexcept {
  const auto found = std::find_if(kProfiles.begin(), kProfiles.end(),
                                  [&](const auto& entry) { return entry.second == profile; });
  return found->first;
}

bool MessageProtection::is_crc_right(std::span<const std::uint8_t> payload) const noexcept {
  if (!has_crc()) return true;
  std::int64_t nibble = data_id >> 8;
  if (data_id_nibble) static_cast<void>(data_id_nibble->decode_raw(payload, nibble));
  const std::uint16_t expected = checksum(payload);
  const bool is_low_right = payload[crc_byte] == (expected & 0xFF);
  const bool is_high_right =
      profile != ProtectionProfile::kE2eP05 || payload[std::size_t{crc_byte} + 1] == expected >> 8;
  // A signed nibble is sign-extended: only its bits count.
  return is_low_right && is_high_right && ((nibble ^ (data_id >> 8)) & 0xF) == 0;
}

std::uint64_t MessageProtection::count(std::span<const std::uint8_t> payload) const noexcept {
  std::int64_t raw = 0;
  static_cast<void>(alive->decode_raw(payload, raw));
  return static_cast<std::uint64_t>(raw) &
         (std::numeric_limits<std::uint64_t>::max() >> (64 - alive->bit_count()));
}

void MessageProtection::write(std::span<std::uint8_t> payload,
                              std::uint64_t counter) const noexcept {
  if (alive) static_cast<void>(alive->encode_raw(payload, static_cast<std::int64_t>(counter)));
  if (data_id_nibble) static_cast<void>(data_id_nibble->encode_raw(payload, data_id >> 8));
  if (!has_crc()) return;
  const std::uint16_t crc = checksum(payload);
  payload[crc_byte] = static_cast<std::uint8_t>(crc & 0xFF);
  if (profile == ProtectionProfile::kE2eP05) {
    payload[std::size_t{crc_byte} + 1] = static_cast<std::uint8_t>(crc >> 8);
  }
}

std::uint16_t MessageProtection::checksum(std::span<const std::uint8_t> payload) const noexcept {
  const std::span<const std::uint8_t> covered = payload.first(length);
  switch (profile) {
    case ProtectionProfile::kNone:
      break;
    case ProtectionProfile::kJ1850: {
      const std::uint8_t before = extend_crc8_1d(0xFF, covered.first(crc_byte));
      return extend_crc8_1d(before, covered.subspan(std::size_t{crc_byte} + 1)) ^ 0xFF;
    }
    case ProtectionProfile::kE2eP01A:
      return e2e_p01_crc(E2eP01Variant::kBoth, data_id, 0, covered, crc_byte);
    case ProtectionProfile::kE2eP01B:
      return e2e_p01_crc(E2eP01Variant::kAlternating, data_id, count(payload), covered, crc_byte);
    case ProtectionProfile::kE2eP01C:
      return e2e_p01_crc(E2eP01Variant::kNibble, data_id, 0, covered, crc_byte);
    case ProtectionProfile::kE2eP02:
      return e2e_p02_crc(data_ids[count(payload)], covered, crc_byte);
    case ProtectionProfile::kE2eP05:
      return e2e_p05_crc(data_id, covered, crc_byte);
  }
  return 0;
}

bool overlap(const DbcSignal& a, const DbcSignal& b) noexcept {
  return (bits_of(a) & bits_of(b)).any();
}

SignalRole role_of(const DbcDatabase& dbc, const DbcSignal& signal) {
  const DbcAttributeValue* const value = dbc.attribute_of(signal, kRoleAttribute);
  if (value == nullptr) return SignalRole::kNone;
  const auto* const name = std::get_if<std::string>(value);
  if (name == nullptr) {
    fail(dbc, signal.position,
         fmt::format("signal {}: attribute {} is a number, expected a text", signal.name,
                     kRoleAttribute));
  }
  const auto found = std::find_if(kRoles.begin(), kRoles.end(),
                                  [&](const auto& role) { return role.first == *name; });
  if (found != kRoles.end()) return found->second;
  fail(dbc, signal.position,
       fmt::format("signal {}: found {} \"{}\", expected \"sync\", \"cycle\", \"command_cycle\", "
                   "\"alive\", \"crc\", \"data_id_nibble\" or \"none\"",
                   signal.name, kRoleAttribute, *name));
}

std::optional<std::uint8_t> bus_of(const DbcDatabase& dbc, const DbcMessage& message) {
  const DbcAttributeValue* const value = dbc.attribute_of(message, kBusAttribute);
  if (value == nullptr) return std::nullopt;
  const std::optional<std::int64_t> bus = integer_of(*value);
  if (bus && *bus >= 0 && *bus <= std::numeric_limits<std::uint8_t>::max()) {
    return static_cast<std::uint8_t>(*bus);
  }
  fail(dbc, message.position,
       fmt::format("message {}: found {} {}, expected an integer of 0 .. 255", message.name,
                   kBusAttribute, describe(*value)));
}

MessageProtection compile_protection(const DbcDatabase& dbc, const DbcMessage& message) {
  return ProtectionBuilder(dbc, message).build();
}

}  // namespace faultline

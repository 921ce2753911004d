#include "drivers/can/frame_bits.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace faultline {
namespace {

/// x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1, without its highest term.
constexpr std::uint32_t kCrc15Polynomial = 0x4599;
constexpr std::uint32_t kCrc15Bits = 15;
/// CRC delimiter.
constexpr std::uint32_t kCrcDelimiter = 1;
/// Acknowledgement, its delimiter, end of frame, intermission.
constexpr std::uint32_t kTail = 1 + 1 + 7 + 3;
/// Stuff count and CRC-17 with a fixed stuff bit in front and behind each four: 21 + 6.
constexpr std::uint32_t kShortFdCrcField = 27;
/// Stuff count and CRC-21: 25 + 7.
constexpr std::uint32_t kLongFdCrcField = 32;
constexpr std::uint8_t kLongestWithCrc17 = 16;
/// Equal bits in a row behind which one is stuffed in.
constexpr std::uint32_t kStuffWidth = 5;

constexpr std::array<std::uint8_t, 16> kFdLengths{0, 1,  2,  3,  4,  5,  6,  7,
                                                  8, 12, 16, 20, 24, 32, 48, 64};

/// Counts the bits of a stuffed field as they are sent.
class StuffedField {
 public:
  /// The lowest `count` bits of `bits`, highest first. The CRC goes on over them.
  void put(std::uint32_t bits, std::uint32_t count) noexcept {
    for (std::uint32_t n = count; n-- > 0;) {
      const std::uint32_t bit = bits >> n & 1u;
      const std::uint32_t feedback = (crc_ >> (kCrc15Bits - 1)) ^ bit;
      crc_ = (crc_ << 1 & 0x7FFF) ^ (feedback != 0 ? kCrc15Polynomial : 0u);
      put_bit(bit);
    }
  }
  void put_crc15() noexcept { put(crc_, kCrc15Bits); }

  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }
  /// The last bit counted was a stuff bit.
  [[nodiscard]] bool ends_with_stuff_bit() const noexcept { return has_just_stuffed_; }

 private:
  void put_bit(std::uint32_t bit) noexcept {
    ++size_;
    run_ = bit == last_ ? run_ + 1 : 1;
    last_ = bit;
    has_just_stuffed_ = run_ == kStuffWidth;
    if (!has_just_stuffed_) return;
    ++size_;  // the stuff bit begins the next run
    last_ ^= 1u;
    run_ = 1;
  }

  std::uint32_t size_ = 0;
  std::uint32_t crc_ = 0;
  std::uint32_t last_ = 2;  ///< of neither value
  std::uint32_t run_ = 0;
  bool has_just_stuffed_ = false;
};

std::uint32_t data_length_code(std::uint8_t length) noexcept {
  const auto* const entry = std::lower_bound(kFdLengths.begin(), kFdLengths.end(), length);
  return static_cast<std::uint32_t>(entry - kFdLengths.begin());
}

/// Start of frame and arbitration, to the bit behind IDE (standard) or RTR (extended). `remote` is
/// the bit RTR, or RRS of an FD frame.
void put_arbitration(StuffedField& field, const CanFrame& frame, std::uint32_t remote) noexcept {
  field.put(0, 1);
  if (frame.is_extended) {
    field.put(frame.id >> 18, 11);
    field.put(0b11, 2);  // SRR, IDE
    field.put(frame.id, 18);
    field.put(remote, 1);
  } else {
    field.put(frame.id, 11);
    field.put(remote, 1);
    field.put(0, 1);  // IDE
  }
}

FrameBits classic_bits(const CanFrame& frame) noexcept {
  StuffedField field;
  put_arbitration(field, frame, frame.is_remote ? 1 : 0);
  field.put(0, frame.is_extended ? 2 : 1);  // r1, r0
  field.put(frame.length, 4);
  if (!frame.is_remote) {
    for (const std::uint8_t byte : frame.payload()) field.put(byte, 8);
  }
  field.put_crc15();
  return {field.size() + kCrcDelimiter + kTail, 0};
}

FrameBits fd_bits(const CanFrame& frame) noexcept {
  StuffedField field;
  put_arbitration(field, frame, 0);
  field.put(0b10, 2);  // FDF, res
  field.put(frame.is_bit_rate_switched ? 1 : 0, 1);
  // A stuff bit behind the BRS bit is already a data bit.
  const std::uint32_t before_switch = field.size() - (field.ends_with_stuff_bit() ? 1u : 0u);
  field.put(frame.is_error_state ? 1 : 0, 1);
  const std::uint32_t dlc = data_length_code(frame.length);
  const std::uint8_t length = kFdLengths[dlc];
  field.put(dlc, 4);
  for (std::size_t n = 0; n < length; ++n) field.put(n < frame.length ? frame.data[n] : 0u, 8);
  // The fixed stuff bit in front of the CRC field stands for one that would be due there.
  const std::uint32_t stuffed = field.size() - (field.ends_with_stuff_bit() ? 1u : 0u);
  const std::uint32_t crc_field = length <= kLongestWithCrc17 ? kShortFdCrcField : kLongFdCrcField;
  const std::uint32_t up_to_delimiter = stuffed + crc_field + kCrcDelimiter;
  if (!frame.is_bit_rate_switched) return {up_to_delimiter + kTail, 0};
  return {before_switch + kTail, up_to_delimiter - before_switch};
}

}  // namespace

FrameBits frame_bits(const CanFrame& frame) noexcept {
  if (frame.is_error) return {};
  return frame.is_fd ? fd_bits(frame) : classic_bits(frame);
}

std::chrono::nanoseconds frame_time(const FrameBits& bits, double bit_rate_Hz,
                                    double data_bit_rate_Hz) noexcept {
  double time_s = bits.nominal / bit_rate_Hz;
  if (bits.data > 0) time_s += bits.data / data_bit_rate_Hz;
  return std::chrono::nanoseconds(std::llround(time_s * 1e9));
}

std::uint8_t padded_fd_length(std::uint8_t length) noexcept {
  return kFdLengths[data_length_code(length)];
}

}  // namespace faultline

#include "drivers/can/frame_bits.h"

#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"
#include "tests/support/random_can_frame.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;

// An independent count: the whole frame as a text of 0 and 1, the CRC by long division, the stuff
// bits really put in.

std::string binary(std::uint32_t value, std::size_t digits) {
  std::string text(digits, '0');
  for (std::size_t n = digits; n-- > 0; value /= 2) text[n] = value % 2 == 0 ? '0' : '1';
  return text;
}

/// Remainder of message(x)·x¹⁵ divided by the generator of CRC-15/CAN.
std::string crc15(const std::string& message) {
  const std::string generator = "1100010110011001";
  std::string rest = message + std::string(15, '0');
  for (std::size_t n = 0; n < message.size(); ++n) {
    if (rest[n] == '0') continue;
    for (std::size_t k = 0; k < generator.size(); ++k) {
      rest[n + k] = rest[n + k] == generator[k] ? '0' : '1';
    }
  }
  return rest.substr(message.size());
}

/// Bits as sent: the original ones, and stuff bits as capital letters O (0) and I (1).
std::string stuff(const std::string& bits) {
  const auto value = [](char bit) { return bit == '0' || bit == 'O' ? 0 : 1; };
  std::string sent;
  for (const char bit : bits) {
    sent += bit;
    if (sent.size() < 5) continue;
    bool are_equal = true;
    for (std::size_t n = sent.size() - 5; n < sent.size(); ++n) {
      are_equal = are_equal && value(sent[n]) == value(sent.back());
    }
    if (are_equal) sent += value(sent.back()) == 0 ? 'I' : 'O';
  }
  return sent;
}

std::string data_bits(const CanFrame& frame, std::size_t length) {
  std::string bits;
  for (std::size_t n = 0; n < length; ++n) bits += binary(frame.data[n], 8);
  return bits;
}

std::string classic_fields(const CanFrame& frame) {
  const std::string remote = frame.is_remote ? "1" : "0";
  std::string bits = "0";
  if (frame.is_extended) {
    const std::string id = binary(frame.id, 29);
    bits += id.substr(0, 11) + "1" + "1" + id.substr(11) + remote + "0" + "0";
  } else {
    bits += binary(frame.id, 11) + remote + "0" + "0";
  }
  bits += binary(frame.length, 4);
  if (!frame.is_remote) bits += data_bits(frame, frame.length);
  return bits;
}

const std::string kTail =
    "1"
    "01"
    "1111111"
    "111";  // CRC delimiter, ACK and delimiter, EOF, IFS

FrameBits count_classic(const CanFrame& frame) {
  const std::string fields = classic_fields(frame);
  const std::string sent = stuff(fields + crc15(fields)) + kTail;
  return {static_cast<std::uint32_t>(sent.size()), 0};
}

/// The CRC field of ISO CAN FD: a fixed stuff bit first and behind each four bits. Its values do
/// not matter to its length.
std::string fd_crc_field(std::size_t crc_bits) {
  std::string field;
  for (std::size_t n = 0; n < 4 + crc_bits; ++n) {
    if (n % 4 == 0) field += 'S';
    field += '0';
  }
  if ((4 + crc_bits) % 4 == 0) field += 'S';
  return field;
}

FrameBits count_fd(const CanFrame& frame) {
  std::size_t dlc = 0, length = 0;
  for (const int possible : {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64}) {
    length = static_cast<std::size_t>(possible);
    if (length >= frame.length) break;
    ++dlc;
  }
  std::string arbitration = "0";
  if (frame.is_extended) {
    const std::string id = binary(frame.id, 29);
    arbitration += id.substr(0, 11) + "11" + id.substr(11) + "0";  // RRS
  } else {
    arbitration += binary(frame.id, 11) + "0" + "0";  // RRS, IDE
  }
  arbitration += "10";  // FDF, res
  arbitration += frame.is_bit_rate_switched ? "1" : "0";
  const std::string rest = (frame.is_error_state ? "1" : "0") +
                           binary(static_cast<std::uint32_t>(dlc), 4) + data_bits(frame, length);
  std::string sent = stuff(arbitration + rest);
  if (sent.back() == 'O' || sent.back() == 'I')
    sent.pop_back();  // the first fixed one stands there
  sent += fd_crc_field(length <= 16 ? 17 : 21);
  sent += kTail;
  std::size_t switch_at = 0;  // how many are sent to the BRS bit, it included
  for (std::size_t originals = 0; originals < arbitration.size(); ++switch_at) {
    originals += sent[switch_at] == '0' || sent[switch_at] == '1' ? 1u : 0u;
  }
  const std::size_t behind_delimiter = kTail.size() - 1;
  const auto total = static_cast<std::uint32_t>(sent.size());
  if (!frame.is_bit_rate_switched) return {total, 0};
  const auto nominal = static_cast<std::uint32_t>(switch_at + behind_delimiter);
  return {nominal, total - nominal};
}

CanFrame classic(std::uint32_t id, std::vector<std::uint8_t> data, bool is_extended = false) {
  CanFrame frame;
  frame.id = id;
  frame.is_extended = is_extended;
  frame.length = static_cast<std::uint8_t>(data.size());
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

TEST(FrameBitsReference, DividesAsTheCrcCatalogueSays) {
  // Check value of CRC-15/CAN: the CRC of the text 123456789 is 0x059E.
  std::string message;
  for (const char digit : std::string("123456789")) {
    message += binary(static_cast<unsigned char>(digit), 8);
  }
  EXPECT_EQ(crc15(message), binary(0x059E, 15));
}

TEST(FrameBitsReference, StuffsAsTheStandardsExample) {
  EXPECT_EQ(stuff("00000"), "00000I");
  EXPECT_EQ(stuff("0000011110"), "00000I1111O0");
  EXPECT_EQ(stuff("000001111"), "00000I1111O");
  EXPECT_EQ(fd_crc_field(17).size(), 27u);  // 4 + 17 and 6 fixed stuff bits
  EXPECT_EQ(fd_crc_field(21).size(), 32u);  // 4 + 21 and 7 fixed stuff bits
}

TEST(FrameBits, CountsAFrameWithoutStuffBits) {
  // 47 bits and 8 for each byte, 67 with 29 bits: with data that never has five equal bits in a row
  // only identifier, control and CRC can be stuffed. These were picked so that none is.
  bool has_found_standard = false, has_found_extended = false;
  for (std::uint32_t id = 0; id < 0x800; ++id) {
    CanFrame frame = classic(id, std::vector<std::uint8_t>(8, 0x55));
    has_found_standard = has_found_standard || frame_bits(frame).nominal == 111;
    EXPECT_GE(frame_bits(frame).nominal, 111u);
    frame.is_extended = true;
    frame.id = 0x15555555 ^ (id << 4);
    has_found_extended = has_found_extended || frame_bits(frame).nominal == 131;
    EXPECT_GE(frame_bits(frame).nominal, 131u);
  }
  EXPECT_TRUE(has_found_standard);
  EXPECT_TRUE(has_found_extended);
}

TEST(FrameBits, CountsAFrameWorkedByHand) {
  // Identifier 0x000, no data: SOF, 11 bits, RTR, IDE, r0 and DLC are 19 zeros, the CRC is 0 too:
  // 34 zeros. A one is stuffed in behind the first five and then behind each four of the zeros left
  // that follow a one: 5, 10, .. 30 zeros: 6 ones. 34 + 6 + 13.
  EXPECT_EQ(frame_bits(classic(0, {})), (FrameBits{53, 0}));
  // The same with 29 bits: SOF, 11 zeros, SRR and IDE 1, then 18 + 1 + 2 + 4 zeros and the CRC.
  EXPECT_EQ(frame_bits(classic(0, {}, true)), count_classic(classic(0, {}, true)));
  CanFrame fd = classic(0, {});
  fd.is_fd = true;
  // SOF, 11 bits, RRS, IDE: 14 zeros, 2 stuff bits; FDF 1, res 0, BRS 0, ESI 0, DLC 0000: behind
  // the one 7 zeros, 1 stuff bit. 22 + 3, then 27, delimiter and 12.
  EXPECT_EQ(frame_bits(fd), (FrameBits{22 + 3 + 27 + 13, 0}));
  fd.is_bit_rate_switched = true;
  // 14 zeros, 2 stuff bits, 1 0 1 at the nominal rate; ESI and DLC: 5 zeros, at whose end the first
  // fixed stuff bit stands for the one that is due.
  EXPECT_EQ(frame_bits(fd), (FrameBits{17 + 2 + 12, 5 + 27 + 1}));
}

TEST(FrameBits, AgreesWithACountBitByBit) {
  std::mt19937_64 generator(11);
  constexpr std::array<std::uint8_t, 6> kStuffy{0x00, 0xFF, 0x0F, 0xF0, 0xF8, 0x07};
  for (int n = 0; n < 30'000; ++n) {
    CanFrame frame = random_can_frame(generator, false);
    if (generator() % 2 == 0 && !frame.is_remote) {
      for (std::size_t k = 0; k < frame.length; ++k) frame.data[k] = kStuffy[generator() % 6];
    }
    if (generator() % 4 == 0) frame.id &= 0x1F00'00F0;
    const FrameBits expected = frame.is_fd ? count_fd(frame) : count_classic(frame);
    ASSERT_EQ(frame_bits(frame), expected)
        << n << ": id " << frame.id << ", length " << int{frame.length} << ", fd " << frame.is_fd
        << ": " << frame_bits(frame).nominal << "+" << frame_bits(frame).data << " for "
        << expected.nominal << "+" << expected.data;
  }
}

TEST(FrameBits, StaysWithinThePublishedBounds) {
  // Davis, Burns, Bril, Lukkien, Controller Area Network (CAN) schedulability analysis, 2007:
  // 47 + 8 s bits and at most floor((34 + 8 s - 1) / 4) stuff bits; 67 and 54 with 29 bits.
  std::mt19937_64 generator(13);
  constexpr std::array<std::uint8_t, 5> kStuffy{0x00, 0xFF, 0x83, 0xE1, 0x3C};
  for (int n = 0; n < 50'000; ++n) {
    CanFrame frame = random_can_frame(generator, false);
    if (frame.is_fd) continue;
    for (std::size_t k = 0; k < frame.length; ++k) {
      frame.data[k] = frame.is_remote ? 0 : kStuffy[generator() % kStuffy.size()];
    }
    const std::uint32_t payload = frame.is_remote ? 0 : frame.length * 8u;
    const std::uint32_t bits = frame_bits(frame).nominal;
    const std::uint32_t least = (frame.is_extended ? 67 : 47) + payload;
    const std::uint32_t stuffed = (frame.is_extended ? 54 : 34) + payload;
    ASSERT_GE(bits, least);
    ASSERT_LE(bits, least + (stuffed - 1) / 4);
  }
  // 24 stuff bits are possible with eight bytes only if each stuff bit begins the next five.
  EXPECT_LE(frame_bits(classic(0x078, {0x78, 0x78, 0x78, 0x78, 0x78, 0x78, 0x78, 0x78})).nominal,
            135u);
}

TEST(FrameBits, PadsAnFdPayloadToTheNextLengthThereIs) {
  EXPECT_EQ(padded_fd_length(0), 0);
  EXPECT_EQ(padded_fd_length(8), 8);
  EXPECT_EQ(padded_fd_length(9), 12);
  EXPECT_EQ(padded_fd_length(33), 48);
  EXPECT_EQ(padded_fd_length(64), 64);
  CanFrame frame = classic(0x555, std::vector<std::uint8_t>(13, 0x55));
  frame.is_fd = true;
  CanFrame padded = frame;
  padded.length = 16;
  EXPECT_EQ(frame_bits(frame), frame_bits(padded));
}

TEST(FrameBits, HasNoneForAnErrorFrame) {
  CanFrame frame;
  frame.is_error = true;
  EXPECT_EQ(frame_bits(frame), FrameBits{});
}

TEST(FrameBits, TakesItsTimeAtBothRates) {
  EXPECT_EQ(frame_time({111, 0}, 500e3), 222us);
  EXPECT_EQ(frame_time({30, 100}, 500e3, 2e6), 60us + 50us);
  EXPECT_EQ(frame_time({1, 0}, 3.0), 333333333ns);
}

TEST(FrameBits, DoesNotAllocate) {
  std::mt19937_64 generator(17);
  const CanFrame frame = random_can_frame(generator, false);
  std::uint64_t bits = 0;
  const AllocationGuard guard;
  for (int step = 0; step < 1000; ++step) bits += frame_bits(frame).nominal;
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_GT(bits, 0u);
}

}  // namespace
}  // namespace faultline

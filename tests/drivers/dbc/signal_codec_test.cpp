#include "drivers/dbc/signal_codec.h"

#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

DbcSignal make_signal(std::uint16_t start, std::uint16_t bits, ByteOrder order, SignalType type,
                      double factor = 1.0, double offset = 0.0) {
  DbcSignal signal;
  signal.name = "s";
  signal.start_bit = start;
  signal.bit_count = bits;
  signal.byte_order = order;
  signal.type = type;
  signal.factor = factor;
  signal.offset = offset;
  return signal;
}

DbcSignal intel(std::uint16_t start, std::uint16_t bits, SignalType type = SignalType::kUnsigned,
                double factor = 1.0, double offset = 0.0) {
  return make_signal(start, bits, ByteOrder::kLittleEndian, type, factor, offset);
}

DbcSignal motorola(std::uint16_t start, std::uint16_t bits, SignalType type = SignalType::kUnsigned,
                   double factor = 1.0, double offset = 0.0) {
  return make_signal(start, bits, ByteOrder::kBigEndian, type, factor, offset);
}

// The reference: the definition of the DBC's bit numbering, one bit at a time. Bits of a signal,
// the most significant first, as positions byte*8 + bit (bit 0 is the byte's least significant).
std::vector<int> bit_positions(const DbcSignal& signal) {
  std::vector<int> positions;
  int position = signal.start_bit;
  if (signal.byte_order == ByteOrder::kLittleEndian) {
    for (int n = signal.bit_count - 1; n >= 0; --n) positions.push_back(position + n);
    return positions;
  }
  for (int n = 0; n < signal.bit_count; ++n) {
    positions.push_back(position);
    position = position % 8 == 0 ? position + 15 : position - 1;
  }
  return positions;
}

std::int64_t reference_decode(const DbcSignal& signal, std::span<const std::uint8_t> payload) {
  std::uint64_t raw = 0;
  for (const int position : bit_positions(signal)) {
    const unsigned byte = payload[static_cast<std::size_t>(position / 8)];
    raw = raw << 1 | ((byte >> (position % 8)) & 1u);
  }
  const bool is_negative =
      signal.type == SignalType::kSigned && (raw >> (signal.bit_count - 1)) != 0;
  if (is_negative && signal.bit_count < 64) raw |= ~std::uint64_t{0} << signal.bit_count;
  return static_cast<std::int64_t>(raw);
}

void reference_encode(const DbcSignal& signal, std::span<std::uint8_t> payload, std::int64_t raw) {
  auto bits = static_cast<std::uint64_t>(raw);
  const std::vector<int> positions = bit_positions(signal);
  for (auto position = positions.rbegin(); position != positions.rend(); ++position) {
    auto& byte = payload[static_cast<std::size_t>(*position / 8)];
    const auto mask = static_cast<std::uint8_t>(1u << (*position % 8));
    byte = static_cast<std::uint8_t>((bits & 1u) != 0 ? byte | mask : byte & ~mask);
    bits >>= 1;
  }
}

std::size_t reference_bytes(const DbcSignal& signal) {
  int last_byte = 0;
  for (const int position : bit_positions(signal)) last_byte = std::max(last_byte, position / 8);
  return static_cast<std::size_t>(last_byte) + 1;
}

/// A random signal that ends within a random payload of up to 64 bytes.
class RandomSignals {
 public:
  explicit RandomSignals(std::uint64_t seed) : engine_(seed) {}

  DbcSignal next() {
    for (;;) {
      const auto order = number(0, 1) == 0 ? ByteOrder::kLittleEndian : ByteOrder::kBigEndian;
      const auto type = number(0, 1) == 0 ? SignalType::kUnsigned : SignalType::kSigned;
      DbcSignal signal = make_signal(static_cast<std::uint16_t>(number(0, 511)),
                                     static_cast<std::uint16_t>(number(1, 64)), order, type);
      if (reference_bytes(signal) <= 64) return signal;
    }
  }

  std::vector<std::uint8_t> payload(std::size_t size) {
    std::vector<std::uint8_t> bytes(size);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(number(0, 255));
    return bytes;
  }

  std::uint64_t number(std::uint64_t least, std::uint64_t most) {
    return std::uniform_int_distribution<std::uint64_t>(least, most)(engine_);
  }

 private:
  std::mt19937_64 engine_;
};

constexpr int kRandomSignals = 100'000;

TEST(SignalCodec, ResolvesStepsOfItsFactorUnlessItIsAFloat) {
  EXPECT_EQ(SignalCodec(intel(0, 24, SignalType::kSigned, -1e-4)).resolution(), 1e-4);
  EXPECT_EQ(SignalCodec(intel(0, 32, SignalType::kFloat32, 2.0)).resolution(), 0.0);
}

TEST(SignalCodec, AgreesWithABitByBitReferenceOnRandomSignals) {
  const std::uint64_t seed = test_seed(20240611);
  SCOPED_TRACE(seed_message(seed));
  RandomSignals random(seed);
  for (int n = 0; n < kRandomSignals; ++n) {
    const DbcSignal signal = random.next();
    const SignalCodec codec(signal);
    const std::size_t needed = reference_bytes(signal);
    ASSERT_EQ(payload_bytes_needed(signal), needed);
    // Exactly as long as needed half of the time, so that reads beyond the end show (ASan).
    const auto size = random.number(0, 1) == 0 ? needed : random.number(needed, 64);
    std::vector<std::uint8_t> payload = random.payload(size);
    std::int64_t raw = 0;
    ASSERT_EQ(codec.decode_raw(payload, raw), CodecStatus::kOk);
    ASSERT_EQ(raw, reference_decode(signal, payload))
        << "start " << signal.start_bit << " bits " << signal.bit_count << " order "
        << (signal.byte_order == ByteOrder::kLittleEndian ? "Intel" : "Motorola");
    const auto new_raw = static_cast<std::int64_t>(random.number(0, ~std::uint64_t{0}));
    std::vector<std::uint8_t> expected = payload;
    reference_encode(signal, expected, new_raw);
    ASSERT_EQ(codec.encode_raw(payload, new_raw), CodecStatus::kOk);
    ASSERT_EQ(payload, expected) << "start " << signal.start_bit << " bits " << signal.bit_count;
  }
}

TEST(SignalCodec, GivesBackWhatItEncodedOnRandomSignals) {
  const std::uint64_t seed = test_seed(7);
  SCOPED_TRACE(seed_message(seed));
  RandomSignals random(seed);
  for (int n = 0; n < kRandomSignals; ++n) {
    DbcSignal signal = random.next();
    signal.bit_count = std::min<std::uint16_t>(signal.bit_count, 50);  // exact in a double
    signal.factor = std::ldexp(1.0, static_cast<int>(random.number(0, 20)) - 10);
    signal.offset = static_cast<double>(random.number(0, 100)) - 50.0;
    const SignalCodec codec(signal);
    std::vector<std::uint8_t> payload = random.payload(payload_bytes_needed(signal));
    const std::vector<std::uint8_t> before = payload;
    double physical = 0.0;
    ASSERT_EQ(codec.decode_physical(payload, physical), CodecStatus::kOk);
    ASSERT_EQ(codec.encode_physical(payload, physical), CodecStatus::kOk);
    ASSERT_EQ(payload, before);
  }
}

TEST(SignalCodec, RefusesEveryPayloadThatIsTooShort) {
  const std::uint64_t seed = test_seed(11);
  SCOPED_TRACE(seed_message(seed));
  RandomSignals random(seed);
  for (int n = 0; n < 1000; ++n) {
    const DbcSignal signal = random.next();
    const SignalCodec codec(signal);
    std::vector<std::uint8_t> payload =
        random.payload(random.number(0, reference_bytes(signal) - 1));
    const std::vector<std::uint8_t> before = payload;
    std::int64_t raw = 42;
    double physical = 4.2;
    ASSERT_EQ(codec.decode_raw(payload, raw), CodecStatus::kPayloadTooShort);
    ASSERT_EQ(codec.decode_physical(payload, physical), CodecStatus::kPayloadTooShort);
    ASSERT_EQ(codec.encode_raw(payload, 1), CodecStatus::kPayloadTooShort);
    ASSERT_EQ(codec.encode_physical(payload, 1.0), CodecStatus::kPayloadTooShort);
    ASSERT_EQ(raw, 42);
    ASSERT_EQ(physical, 4.2);
    ASSERT_EQ(payload, before);
  }
}

TEST(SignalCodec, ReadsASignalAcrossNineBytes) {
  std::array<std::uint8_t, 9> payload{0x10, 0x32, 0x54, 0x76, 0x98, 0xBA, 0xDC, 0xFE, 0x0F};
  std::int64_t raw = 0;
  ASSERT_EQ(SignalCodec(intel(4, 64)).decode_raw(payload, raw), CodecStatus::kOk);
  EXPECT_EQ(static_cast<std::uint64_t>(raw), 0xFFED'CBA9'8765'4321u);
  ASSERT_EQ(SignalCodec(motorola(3, 64)).decode_raw(payload, raw), CodecStatus::kOk);
  EXPECT_EQ(static_cast<std::uint64_t>(raw), 0x0325'4769'8BAD'CFE0u);
}

TEST(SignalCodec, AppliesFactorAndOffset) {
  const std::array<std::uint8_t, 2> payload{0x9C, 0xFF};  // -100
  double physical = 0.0;
  const SignalCodec codec(intel(0, 16, SignalType::kSigned, 0.5, 10.0));
  ASSERT_EQ(codec.decode_physical(payload, physical), CodecStatus::kOk);
  EXPECT_EQ(physical, -40.0);
}

TEST(SignalCodec, RoundsToTheNearestAndTiesToEven) {
  const SignalCodec codec(intel(0, 8, SignalType::kSigned));
  const auto encoded = [&](double physical) {
    std::array<std::uint8_t, 1> payload{};
    EXPECT_EQ(codec.encode_physical(payload, physical), CodecStatus::kOk);
    return static_cast<int>(static_cast<std::int8_t>(payload[0]));
  };
  EXPECT_EQ(encoded(1.4999), 1);
  EXPECT_EQ(encoded(1.5), 2);
  EXPECT_EQ(encoded(2.5), 2);
  EXPECT_EQ(encoded(-1.5), -2);
  EXPECT_EQ(encoded(-0.4), 0);
  EXPECT_EQ(encoded(127.4), 127);
  EXPECT_EQ(encoded(-128.5), -128);
}

TEST(SignalCodec, ClampsToWhatTheBitsHold) {
  struct Case {
    std::uint16_t bits;
    SignalType type;
    std::int64_t least, most;
  };
  constexpr auto kLeast = std::numeric_limits<std::int64_t>::min();
  constexpr auto kMost = std::numeric_limits<std::int64_t>::max();
  for (const Case& c :
       {Case{1, SignalType::kUnsigned, 0, 1}, Case{1, SignalType::kSigned, -1, 0},
        Case{8, SignalType::kUnsigned, 0, 255}, Case{8, SignalType::kSigned, -128, 127},
        Case{63, SignalType::kUnsigned, 0, kMost}, Case{64, SignalType::kSigned, kLeast, kMost},
        Case{64, SignalType::kUnsigned, 0, -1}}) {  // -1: all ones
    const SignalCodec codec(intel(0, c.bits, c.type));
    for (const double huge : {1e30, kInfinity}) {
      std::array<std::uint8_t, 8> payload{};
      std::int64_t raw = 0;
      EXPECT_EQ(codec.encode_physical(payload, huge), CodecStatus::kOutOfRange);
      EXPECT_EQ(codec.decode_raw(payload, raw), CodecStatus::kOk);
      EXPECT_EQ(raw, c.most) << c.bits << " bits";
      EXPECT_EQ(codec.encode_physical(payload, -huge), CodecStatus::kOutOfRange);
      EXPECT_EQ(codec.decode_raw(payload, raw), CodecStatus::kOk);
      EXPECT_EQ(raw, c.least) << c.bits << " bits";
    }
  }
}

TEST(SignalCodec, HoldsTheLargestNumbersOfSixtyFourBits) {
  const SignalCodec codec(motorola(7, 64));
  std::array<std::uint8_t, 8> payload{};
  std::int64_t raw = 0;
  const double largest = std::nextafter(0x1p64, 0.0);
  EXPECT_EQ(codec.encode_physical(payload, largest), CodecStatus::kOk);
  EXPECT_EQ(codec.decode_raw(payload, raw), CodecStatus::kOk);
  EXPECT_EQ(static_cast<std::uint64_t>(raw), 0xFFFF'FFFF'FFFF'F800u);
  EXPECT_EQ(codec.encode_physical(payload, 0x1p64), CodecStatus::kOutOfRange);
}

TEST(SignalCodec, DoesNotLimitToMinimumAndMaximum) {
  DbcSignal signal = intel(0, 8);
  signal.minimum = 0.0;
  signal.maximum = 10.0;
  std::array<std::uint8_t, 1> payload{};
  EXPECT_EQ(SignalCodec(signal).encode_physical(payload, 200.0), CodecStatus::kOk);
  EXPECT_EQ(payload[0], 200);
}

TEST(SignalCodec, WritesNothingForNaN) {
  for (const auto type : {SignalType::kUnsigned, SignalType::kFloat32}) {
    std::array<std::uint8_t, 4> payload{1, 2, 3, 4};
    const auto before = payload;
    EXPECT_EQ(SignalCodec(intel(0, 32, type))
                  .encode_physical(payload, std::numeric_limits<double>::quiet_NaN()),
              CodecStatus::kNotANumber);
    EXPECT_EQ(payload, before);
  }
}

TEST(SignalCodec, CarriesFloats) {
  for (const auto order : {ByteOrder::kLittleEndian, ByteOrder::kBigEndian}) {
    const std::uint16_t start = order == ByteOrder::kLittleEndian ? 0 : 7;
    std::array<std::uint8_t, 8> payload{};
    double physical = 0.0;
    const SignalCodec single(make_signal(start, 32, order, SignalType::kFloat32));
    ASSERT_EQ(single.encode_physical(payload, 0.1), CodecStatus::kOk);
    ASSERT_EQ(single.decode_physical(payload, physical), CodecStatus::kOk);
    EXPECT_EQ(physical, static_cast<double>(0.1f));
    const SignalCodec twice(make_signal(start, 64, order, SignalType::kFloat64));
    ASSERT_EQ(twice.encode_physical(payload, 0.1), CodecStatus::kOk);
    ASSERT_EQ(twice.decode_physical(payload, physical), CodecStatus::kOk);
    EXPECT_EQ(physical, 0.1);
    std::int64_t raw = 0;
    ASSERT_EQ(twice.decode_raw(payload, raw), CodecStatus::kOk);
    EXPECT_EQ(raw, std::bit_cast<std::int64_t>(0.1));
  }
}

TEST(SignalCodec, ClampsFloatsToTheLargestFiniteOne) {
  const SignalCodec codec(intel(0, 32, SignalType::kFloat32));
  std::array<std::uint8_t, 4> payload{};
  double physical = 0.0;
  for (const double huge : {1e300, kInfinity}) {
    EXPECT_EQ(codec.encode_physical(payload, -huge), CodecStatus::kOutOfRange);
    EXPECT_EQ(codec.decode_physical(payload, physical), CodecStatus::kOk);
    EXPECT_EQ(physical, -static_cast<double>(std::numeric_limits<float>::max()));
  }
}

TEST(SignalCodec, SaysNotANumberForFloatsThatAreNotFinite) {
  const SignalCodec codec(intel(0, 32, SignalType::kFloat32));
  for (const float value :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    std::array<std::uint8_t, 4> payload{};
    EXPECT_EQ(codec.encode_raw(payload, std::bit_cast<std::int32_t>(value)), CodecStatus::kOk);
    double physical = 4.2;
    EXPECT_EQ(codec.decode_physical(payload, physical), CodecStatus::kNotANumber);
    EXPECT_EQ(physical, 4.2);
  }
}

TEST(SignalCodec, RefusesSignalsItCannotCode) {
  EXPECT_THROW(SignalCodec(intel(0, 0)), std::invalid_argument);
  EXPECT_THROW(SignalCodec(intel(0, 65)), std::invalid_argument);
  EXPECT_THROW(SignalCodec(intel(505, 8)), std::invalid_argument);
  EXPECT_THROW(SignalCodec(motorola(504, 2)), std::invalid_argument);
  EXPECT_THROW(SignalCodec(intel(0, 8, SignalType::kUnsigned, 0.0)), std::invalid_argument);
  EXPECT_THROW(SignalCodec(intel(0, 8, SignalType::kUnsigned, kInfinity)), std::invalid_argument);
  EXPECT_THROW(SignalCodec(intel(0, 16, SignalType::kFloat32)), std::invalid_argument);
  EXPECT_THROW(SignalCodec(intel(0, 32, SignalType::kFloat64)), std::invalid_argument);
  EXPECT_NO_THROW(SignalCodec(intel(504, 8)));
  EXPECT_NO_THROW(SignalCodec(motorola(511, 8)));
}

TEST(SignalCodec, SaysTooShortWhenItWasNeverSetUp) {
  const SignalCodec codec;
  std::array<std::uint8_t, 8> payload{};
  std::int64_t raw = 0;
  EXPECT_EQ(codec.decode_raw(payload, raw), CodecStatus::kPayloadTooShort);
  EXPECT_EQ(codec.encode_raw(payload, 1), CodecStatus::kPayloadTooShort);
}

TEST(SignalCodec, DoesNotAllocate) {
  const SignalCodec codec(motorola(3, 33, SignalType::kSigned, 0.01, 5.0));
  std::array<std::uint8_t, 64> payload{};
  double sum = 0.0;
  const AllocationGuard guard;
  for (int step = 0; step < 1000; ++step) {
    double physical = 0.0;
    static_cast<void>(codec.encode_physical(payload, step * 0.37));
    static_cast<void>(codec.decode_physical(payload, physical));
    sum += physical;
  }
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_GT(sum, 0.0);
}

}  // namespace
}  // namespace faultline

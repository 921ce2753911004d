#include "drivers/dbc/message_codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "drivers/dbc/signal_codec.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr auto kPresent = SignalPresence::kPresent;
constexpr auto kNotSelected = SignalPresence::kNotSelected;
constexpr auto kBeyondPayload = SignalPresence::kBeyondPayload;
constexpr auto kNotCodable = SignalPresence::kNotCodable;

DbcSignal make_signal(std::uint16_t start, std::uint16_t bits, ByteOrder order, SignalType type,
                      double factor = 1.0, double offset = 0.0) {
  DbcSignal signal;
  signal.name = "s" + std::to_string(start);
  signal.start_bit = start;
  signal.bit_count = bits;
  signal.byte_order = order;
  signal.type = type;
  signal.factor = factor;
  signal.offset = offset;
  return signal;
}

DbcSignal intel(std::uint16_t start, std::uint16_t bits, double factor = 1.0, double offset = 0.0) {
  return make_signal(start, bits, ByteOrder::kLittleEndian, SignalType::kUnsigned, factor, offset);
}

DbcSignal selected_by(std::int32_t multiplexer, DbcMultiplexRange range, DbcSignal signal) {
  signal.multiplexer = multiplexer;
  signal.multiplexer_ranges.push_back(range);
  return signal;
}

DbcMessage make_message(std::vector<DbcSignal> signals) {
  DbcMessage message;
  message.name = "M";
  message.length = 8;
  message.signals = std::move(signals);
  return message;
}

using Bytes = std::vector<std::uint8_t>;

struct Decoded {
  std::size_t count = 0;
  std::vector<double> values;
  std::vector<SignalPresence> presence;
};

constexpr double kUntouched = 4.25;

Decoded decode(const MessageCodec& codec, const Bytes& payload) {
  Decoded decoded;
  decoded.values.assign(codec.signal_count(), kUntouched);
  decoded.presence.assign(codec.signal_count(), SignalPresence::kNotANumber);
  decoded.count = codec.decode(payload, decoded.values, decoded.presence);
  return decoded;
}

// The reference: the definition of the DBC's bit numbering, one bit at a time; positions are
// byte*8 + bit, the most significant first.
std::vector<std::size_t> bit_positions(const DbcSignal& signal) {
  std::vector<std::size_t> positions;
  std::size_t position = signal.start_bit;
  for (int n = 0; n < signal.bit_count; ++n) {
    positions.push_back(position);
    if (signal.byte_order == ByteOrder::kLittleEndian) {
      ++position;
    } else {
      position = position % 8 == 0 ? position + 15 : position - 1;
    }
  }
  if (signal.byte_order == ByteOrder::kLittleEndian) {
    std::reverse(positions.begin(), positions.end());
  }
  return positions;
}

bool reference_bits(const DbcSignal& signal, const Bytes& payload, std::uint64_t& bits) {
  bits = 0;
  for (const std::size_t position : bit_positions(signal)) {
    if (position / 8 >= payload.size()) return false;
    bits = bits << 1 | (payload[position / 8] >> (position % 8) & 1u);
  }
  return true;
}

/// What the format says of one signal in one payload, in 80-bit arithmetic.
SignalPresence reference_decode(const DbcMessage& message, const DbcSignal& signal,
                                const Bytes& payload, long double& value) {
  std::uint64_t bits = 0;
  SignalPresence presence = kPresent;
  for (const DbcSignal* at = &signal; at->multiplexer >= 0;) {
    const DbcSignal& multiplexer = message.signals[static_cast<std::size_t>(at->multiplexer)];
    if (!reference_bits(multiplexer, payload, bits)) {
      presence = kBeyondPayload;
    } else if (std::none_of(at->multiplexer_ranges.begin(), at->multiplexer_ranges.end(),
                            [&](const DbcMultiplexRange& range) {
                              return range.first <= bits && bits <= range.last;
                            })) {
      return kNotSelected;
    }
    at = &multiplexer;
  }
  if (presence != kPresent) return presence;
  if (!reference_bits(signal, payload, bits)) return kBeyondPayload;
  long double raw = 0.0L;
  if (signal.type == SignalType::kFloat32) {
    raw = std::bit_cast<float>(static_cast<std::uint32_t>(bits));
  } else if (signal.type == SignalType::kFloat64) {
    raw = std::bit_cast<double>(bits);
  } else if (signal.type == SignalType::kSigned && (bits >> (signal.bit_count - 1)) != 0) {
    raw = static_cast<long double>(bits) - std::ldexp(1.0L, signal.bit_count);
  } else {
    raw = static_cast<long double>(bits);
  }
  value = raw * signal.factor + signal.offset;
  return std::isfinite(static_cast<double>(value)) ? kPresent : SignalPresence::kNotANumber;
}

class RandomMessages {
 public:
  explicit RandomMessages(std::uint64_t seed) : engine_(seed) {}

  std::uint64_t below(std::uint64_t limit) { return engine_() % limit; }

  DbcSignal signal(std::size_t bytes) {
    for (;;) {
      DbcSignal signal = make_signal(
          static_cast<std::uint16_t>(below(8 * bytes)), static_cast<std::uint16_t>(1 + below(64)),
          below(2) == 0 ? ByteOrder::kLittleEndian : ByteOrder::kBigEndian,
          below(2) == 0 ? SignalType::kUnsigned : SignalType::kSigned,
          std::ldexp(static_cast<double>(1 + below(9)), static_cast<int>(below(12)) - 8),
          static_cast<double>(below(2000)) - 1000.0);
      if (below(8) == 0) {
        signal.bit_count = below(2) == 0 ? 32 : 64;
        signal.type = signal.bit_count == 32 ? SignalType::kFloat32 : SignalType::kFloat64;
      }
      if (below(4) == 0) signal.factor = -signal.factor;
      if (payload_bytes_needed(signal) <= bytes) return signal;
    }
  }

  DbcMessage message() {
    const std::size_t bytes = below(3) == 0 ? 9 + below(56) : 8;
    DbcMessage message = make_message({});
    const std::size_t count = below(9);
    for (std::size_t n = 0; n < count; ++n) {
      DbcSignal added = signal(bytes);
      if (n > 0 && below(3) == 0) {
        added.multiplexer = static_cast<std::int32_t>(below(n));
        std::uint64_t from = below(3);
        for (std::uint64_t k = 0; k <= below(3); ++k) {
          added.multiplexer_ranges.push_back({from, from + below(4)});
          from = added.multiplexer_ranges.back().last + 1 + below(5);
        }
      }
      message.signals.push_back(std::move(added));
    }
    message.length = static_cast<std::uint16_t>(bytes);
    return message;
  }

  Bytes payload(std::size_t size) {
    Bytes bytes(size);
    // Few different bytes, so that multiplexers select something; ones, so that floats are NaN.
    const std::uint64_t limit = below(2) == 0 ? 256 : 4;
    if (below(16) == 0) return Bytes(size, 0xFF);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(below(limit));
    return bytes;
  }

 private:
  std::mt19937_64 engine_;
};

TEST(MessageCodec, AgreesWithABitByBitReferenceOnRandomMessages) {
  const std::uint64_t seed = test_seed(20240612);
  SCOPED_TRACE(seed_message(seed));
  RandomMessages random(seed);
  std::array<std::size_t, 5> seen{};
  for (int n = 0; n < 20'000; ++n) {
    const DbcMessage message = random.message();
    const MessageCodec codec(message);
    const Bytes payload =
        random.payload(random.below(3) == 0 ? random.below(message.length + 1u) : message.length);
    const Decoded decoded = decode(codec, payload);
    std::size_t present = 0;
    for (std::size_t k = 0; k < message.signals.size(); ++k) {
      long double expected = 0.0L;
      const SignalPresence presence =
          reference_decode(message, message.signals[k], payload, expected);
      ASSERT_EQ(decoded.presence[k], presence);
      ++seen[static_cast<std::size_t>(presence)];
      if (presence != kPresent) {
        ASSERT_EQ(decoded.values[k], kUntouched);
        continue;
      }
      ++present;
      // The 80-bit reference itself is right to 2^-63 of its terms.
      const long double slack =
          std::ldexp(std::abs(expected) + std::abs(expected - message.signals[k].offset), -61);
      ASSERT_LE(std::abs(decoded.values[k] - expected),
                std::ldexp(std::abs(expected), -51) + slack);
    }
    ASSERT_EQ(decoded.count, present);
  }
  EXPECT_GT(seen[static_cast<std::size_t>(kPresent)], 10'000u);
  EXPECT_GT(seen[static_cast<std::size_t>(kNotSelected)], 1000u);
  EXPECT_GT(seen[static_cast<std::size_t>(kBeyondPayload)], 1000u);
  EXPECT_GT(seen[static_cast<std::size_t>(SignalPresence::kNotANumber)], 10u);
}

TEST(MessageCodec, GivesTheSameBitsAsASignalCodecOnItsOwn) {
  const std::uint64_t seed = test_seed(20240613);
  SCOPED_TRACE(seed_message(seed));
  RandomMessages random(seed);
  constexpr std::array kFactors{0.001, 0.1, 1e-7, 0.3, -0.007, 1.0, 12345.678901234567};
  constexpr std::array kOffsets{-32.0, 0.0, -214.7483648, -0.1, 3670.016};
  for (int n = 0; n < 20'000; ++n) {
    DbcMessage message = random.message();
    for (DbcSignal& signal : message.signals) {
      signal.multiplexer = DbcSignal::kAlwaysPresent;
      signal.factor = kFactors[random.below(kFactors.size())];
      signal.offset = kOffsets[random.below(kOffsets.size())];
    }
    const Bytes payload = random.payload(message.length);
    const Decoded decoded = decode(MessageCodec(message), payload);
    for (std::size_t k = 0; k < message.signals.size(); ++k) {
      double alone = kUntouched;
      static_cast<void>(SignalCodec(message.signals[k]).decode_physical(payload, alone));
      ASSERT_EQ(std::bit_cast<std::uint64_t>(decoded.values[k]),
                std::bit_cast<std::uint64_t>(alone));
    }
  }
}

TEST(MessageCodec, LosesNoDigitsWhereFactorAndOffsetCancel) {
  const MessageCodec codec(
      make_message({intel(0, 16, 0.001, -32.0), intel(16, 32, 1e-7, -214.7483648),
                    intel(48, 16, 0.01, -327.68)}));
  const auto value = [&](std::uint16_t first, std::uint32_t second, std::uint16_t third) {
    const Bytes payload{
        static_cast<std::uint8_t>(first),        static_cast<std::uint8_t>(first >> 8),
        static_cast<std::uint8_t>(second),       static_cast<std::uint8_t>(second >> 8),
        static_cast<std::uint8_t>(second >> 16), static_cast<std::uint8_t>(second >> 24),
        static_cast<std::uint8_t>(third),        static_cast<std::uint8_t>(third >> 8)};
    return decode(codec, payload).values;
  };
  EXPECT_EQ(value(32'001, 2'147'483'649u, 32'769), (std::vector<double>{0.001, 1e-7, 0.01}));
  EXPECT_EQ(value(32'000, 2'147'483'648u, 32'768), (std::vector<double>{0.0, 0.0, 0.0}));
  EXPECT_EQ(value(31'999, 2'147'483'647u, 32'767), (std::vector<double>{-0.001, -1e-7, -0.01}));
}

TEST(MessageCodec, EncodesEveryRawValueItDecodedBackToItself) {
  const std::uint64_t seed = test_seed(20240614);
  SCOPED_TRACE(seed_message(seed));
  RandomMessages random(seed);
  constexpr std::array kFactors{0.001, 0.1,   1e-7, 0.3,  -0.007,          1.0,  1.0 / 3.0,
                                7e22,  1e-30, 3.0,  0.01, 0.0078431372549, -1e-3};
  for (int n = 0; n < 200'000; ++n) {
    DbcSignal signal = random.signal(8);
    if (signal.type == SignalType::kFloat32 || signal.type == SignalType::kFloat64) continue;
    signal.factor = kFactors[random.below(kFactors.size())];
    // An offset of up to 2^bits steps, as real ones are; the sum must fit 53 bits.
    const int bits = std::min<int>(signal.bit_count, 52);
    signal.bit_count = static_cast<std::uint16_t>(bits);
    signal.offset =
        random.below(3) == 0
            ? 0.0
            : -signal.factor * std::ldexp(static_cast<double>(random.below(1000)), bits - 11);
    const MessageCodec codec(make_message({signal}));
    const Bytes payload = random.payload(8);
    const Decoded decoded = decode(codec, payload);
    ASSERT_EQ(decoded.count, 1u);
    Bytes encoded = payload;
    std::int64_t raw = 0;
    ASSERT_EQ(SignalCodec(signal).decode_raw(payload, raw), CodecStatus::kOk);
    ASSERT_EQ(SignalCodec(signal).encode_raw(encoded, ~raw), CodecStatus::kOk);
    ASSERT_EQ(codec.encode(decoded.values, encoded), 0u);
    ASSERT_EQ(encoded, payload) << "factor " << signal.factor << " offset " << signal.offset
                                << " raw " << raw << " bits " << signal.bit_count;
  }
}

TEST(MessageCodec, KeepsTheSignOfAFloatsZero) {
  DbcSignal signal = intel(0, 32);
  signal.type = SignalType::kFloat32;
  const MessageCodec codec(make_message({signal}));
  const Bytes minus_zero{0, 0, 0, 0x80};
  const Decoded decoded = decode(codec, minus_zero);
  EXPECT_TRUE(std::signbit(decoded.values[0]));
  Bytes encoded(4);
  EXPECT_EQ(codec.encode(decoded.values, encoded), 0u);
  EXPECT_EQ(encoded, minus_zero);
}

TEST(MessageCodec, ReportsWhichMultiplexedSignalsAreThere) {
  const MessageCodec codec(make_message({intel(0, 4), selected_by(0, {0, 1}, intel(8, 8)),
                                         selected_by(0, {2, 2}, intel(4, 4)),
                                         selected_by(2, {7, 9}, intel(8, 16)), intel(24, 8)}));
  const Decoded first = decode(codec, {0x01, 42, 0, 7});
  EXPECT_EQ(first.presence,
            (std::vector{kPresent, kPresent, kNotSelected, kNotSelected, kPresent}));
  EXPECT_EQ(first.count, 3u);
  EXPECT_EQ(first.values, (std::vector{1.0, 42.0, kUntouched, kUntouched, 7.0}));
  const Decoded second = decode(codec, {0x82, 42, 1, 7});
  EXPECT_EQ(second.presence, (std::vector{kPresent, kNotSelected, kPresent, kPresent, kPresent}));
  EXPECT_EQ(second.values, (std::vector{2.0, kUntouched, 8.0, 298.0, 7.0}));
}

TEST(MessageCodec, ReadsWhatAShortPayloadHolds) {
  const MessageCodec codec(make_message(
      {intel(0, 8), intel(8, 8), intel(12, 8), selected_by(2, {0, 255}, intel(0, 4))}));
  const Decoded decoded = decode(codec, {1, 2});
  EXPECT_EQ(decoded.presence, (std::vector{kPresent, kPresent, kBeyondPayload, kBeyondPayload}));
  EXPECT_EQ(decode(codec, {}).count, 0u);
}

TEST(MessageCodec, ReadsTheOthersBesideSignalsThatHaveNoValue) {
  DbcSignal float_of_16 = intel(0, 16);
  float_of_16.type = SignalType::kFloat32;
  const MessageCodec codec(make_message(
      {intel(0, 8), intel(8, 8, 0.0), intel(0, 0), intel(0, 65), intel(510, 8), float_of_16,
       intel(8, 8, kNaN), selected_by(1, {3, 3}, intel(16, 8)), selected_by(8, {0, 9}, intel(0, 8)),
       selected_by(2, {0, 9}, intel(0, 8)), selected_by(99, {0, 9}, intel(0, 8))}));
  const Decoded decoded = decode(codec, {1, 3, 5, 0, 0, 0, 0, 0});
  EXPECT_EQ(decoded.presence,
            (std::vector{kPresent, kNotCodable, kNotCodable, kNotCodable, kNotCodable, kNotCodable,
                         kNotCodable, kPresent, kNotCodable, kNotCodable, kNotCodable}));
  EXPECT_EQ(decoded.values[7], 5.0);  // a multiplexer needs bits, not a value
  Bytes payload(8);
  std::vector<double> values(11, 300.0);
  values[0] = 7.0;
  EXPECT_EQ(codec.encode(values, payload), 0u);
  EXPECT_EQ(payload, (Bytes{7, 0, 0, 0, 0, 0, 0, 0}));
}

TEST(MessageCodec, ClampsOrRefusesWhatDoesNotFit) {
  const MessageCodec codec(make_message({intel(0, 8), intel(8, 8, 0.5, -10.0), intel(60, 8)}));
  const std::vector<double> values{300.0, -20.0, 1.0};
  Bytes payload{1, 2, 3, 4, 5, 6, 7, 8};
  const Bytes before = payload;
  EXPECT_EQ(codec.encode(values, payload, OutOfRange::kRefuse), 3u);
  EXPECT_EQ(payload, before);
  EXPECT_EQ(codec.encode(values, payload, OutOfRange::kClamp), 3u);
  EXPECT_EQ(payload, (Bytes{255, 0, 3, 4, 5, 6, 7, 8}));
  Bytes longer(9);
  EXPECT_EQ(codec.encode(std::vector{30.0, 2.25, 255.0}, longer, OutOfRange::kRefuse), 0u);
  EXPECT_EQ(longer, (Bytes{30, 24, 0, 0, 0, 0, 0, 0xF0, 0x0F}));
}

TEST(MessageCodec, LeavesTheBitsOfNaNAndOfSignalsNotSelected) {
  const MessageCodec codec(make_message(
      {intel(0, 8), selected_by(0, {1, 1}, intel(8, 8)), selected_by(0, {2, 2}, intel(16, 8))}));
  Bytes payload{9, 9, 9};
  EXPECT_EQ(codec.encode(std::vector{1.0, kNaN, 5.0}, payload), 1u);
  EXPECT_EQ(payload, (Bytes{1, 9, 9}));
  EXPECT_EQ(codec.encode(std::vector{2.0, 7.0, 5.0}, payload), 0u);
  EXPECT_EQ(payload, (Bytes{2, 9, 5}));
  // A multiplexer without a value: the payload's own bits select.
  EXPECT_EQ(codec.encode(std::vector{kNaN, 7.0, 6.0}, payload), 1u);
  EXPECT_EQ(payload, (Bytes{2, 9, 6}));
}

TEST(MessageCodec, OfNoMessageHasNoSignals) {
  const MessageCodec codec;
  EXPECT_EQ(codec.signal_count(), 0u);
  EXPECT_EQ(codec.decode(Bytes{1, 2}, {}, {}), 0u);
  Bytes payload{1};
  EXPECT_EQ(codec.encode({}, payload), 0u);
}

TEST(MessageCodec, DoesNotAllocate) {
  const MessageCodec codec(
      make_message({intel(0, 8), selected_by(0, {1, 9}, intel(8, 8)), intel(16, 16, 0.01, -5.0),
                    intel(32, 53), intel(24, 8), intel(20, 5)}));
  std::array<double, 6> values{};
  std::array<SignalPresence, 6> presence{};
  std::array<std::uint8_t, 64> payload{1, 2, 3, 4, 5, 6, 7, 8};
  std::size_t sum = 0;
  const AllocationGuard guard;
  for (std::size_t step = 0; step < 1000; ++step) {
    sum += codec.decode(std::span(payload).first(step % 65), values, presence);
    sum += codec.encode(values, std::span(payload).first(step % 65),
                        step % 2 == 0 ? OutOfRange::kClamp : OutOfRange::kRefuse);
  }
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_GT(sum, 0u);
}

}  // namespace
}  // namespace faultline

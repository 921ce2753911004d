// Any layout of signals and any payload: decoding stays within the payload, what it gives encodes
// to something that decodes to the same, and encoding leaves all other bits alone.
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <vector>

#include "drivers/dbc/message_codec.h"
#include "drivers/dbc/signal_codec.h"

namespace {

using namespace faultline;

void require(bool holds) {
  if (!holds) std::abort();
}

/// Takes numbers from the front of the input; zeros when that is used up.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  template <class T>
  T take() {
    T value{};
    const std::size_t bytes = std::min(sizeof value, size_);
    std::memcpy(&value, data_, bytes);
    data_ += bytes;
    size_ -= bytes;
    return value;
  }
  [[nodiscard]] std::vector<std::uint8_t> rest(std::size_t most) const {
    return {data_, data_ + std::min(size_, most)};
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
};

double take_scale(Input& input) {
  constexpr double kUsual[] = {1.0, 0.0, 0.001, -32.0, 0.1, -40.0, 1e-7, -214.7483648, 0.5, -1.0};
  const auto kind = input.take<std::uint8_t>();
  return kind < std::size(kUsual) ? kUsual[kind] : input.take<double>();
}

DbcMessage take_message(Input& input) {
  DbcMessage message;
  message.signals.resize(input.take<std::uint8_t>() % 9);
  for (DbcSignal& signal : message.signals) {
    signal.name = "s";
    signal.start_bit = input.take<std::uint16_t>() % 600;
    signal.bit_count = input.take<std::uint8_t>() % 70;
    const auto flags = input.take<std::uint8_t>();
    signal.byte_order = (flags & 1) != 0 ? ByteOrder::kBigEndian : ByteOrder::kLittleEndian;
    signal.type = static_cast<SignalType>((flags >> 1) & 3);
    signal.factor = take_scale(input);
    signal.offset = take_scale(input);
    if ((flags & 8) == 0) continue;
    signal.multiplexer = input.take<std::int8_t>() % 10;
    const auto first = input.take<std::uint8_t>();
    signal.multiplexer_ranges = {{first, first + std::uint64_t{input.take<std::uint8_t>()}}};
  }
  return message;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Input input(data, size);
  const DbcMessage message = take_message(input);
  const MessageCodec codec(message);
  const std::size_t count = codec.signal_count();
  // Exactly as long as it says, on the heap: a read beyond shows.
  const std::vector<std::uint8_t> payload = input.rest(64);
  std::vector<double> values(count, std::numeric_limits<double>::quiet_NaN());
  std::vector<SignalPresence> presence(count);
  const std::size_t present = codec.decode(payload, values, presence);
  std::size_t counted = 0;
  for (std::size_t n = 0; n < count; ++n) {
    const bool is_present = presence[n] == SignalPresence::kPresent;
    counted += is_present ? 1 : 0;
    require(is_present == std::isfinite(values[n]));
    if (!is_present) continue;
    // Alone it gives the same bits.
    double alone = 0.0;
    require(SignalCodec(message.signals[n]).decode_physical(payload, alone) == CodecStatus::kOk);
    require(std::bit_cast<std::uint64_t>(alone) == std::bit_cast<std::uint64_t>(values[n]));
  }
  require(counted == present);

  // One signal at a time: overlapping ones would undo each other.
  for (std::size_t n = 0; n < count; ++n) {
    if (presence[n] != SignalPresence::kPresent) continue;
    const SignalCodec one(message.signals[n]);
    std::vector<std::uint8_t> encoded = payload;
    require(one.encode_raw(encoded, 0) == CodecStatus::kOk);
    std::vector<std::uint8_t> inverted = payload;
    require(one.encode_raw(inverted, -1) == CodecStatus::kOk);
    const CodecStatus status = one.encode_physical(encoded, values[n]);
    require(status == CodecStatus::kOk || status == CodecStatus::kOutOfRange);
    for (std::size_t k = 0; k < payload.size(); ++k) {
      std::vector<std::uint8_t> none = payload;
      require(one.encode_raw(none, 0) == CodecStatus::kOk);
      const auto ours = static_cast<std::uint8_t>(none[k] ^ inverted[k]);
      require(((encoded[k] ^ payload[k]) & ~ours) == 0);
    }
    // Narrow integers come back to the bit where the double has room for them.
    const DbcSignal& signal = message.signals[n];
    const bool is_integer =
        signal.type == SignalType::kUnsigned || signal.type == SignalType::kSigned;
    const double steps =
        std::ldexp(1.0, signal.bit_count) + std::abs(signal.offset / signal.factor);
    const bool is_usual = std::abs(signal.factor) > 1e-150 && std::abs(signal.factor) < 1e150 &&
                          std::abs(signal.offset) < 1e150 &&
                          (signal.offset == 0.0 || std::abs(signal.offset) > 1e-150);
    if (is_integer && is_usual && steps < 0x1p51) require(encoded == payload);
  }

  // All at once, and both ways of treating what does not fit.
  std::vector<std::uint8_t> clamped = payload;
  std::vector<std::uint8_t> refused = payload;
  const std::size_t misfits = codec.encode(values, clamped, OutOfRange::kClamp);
  require(codec.encode(values, refused, OutOfRange::kRefuse) == misfits);
  require(misfits == 0 ? refused == clamped : refused == payload);
  return 0;
}

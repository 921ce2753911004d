// DBC: loading files of a real car's size, and decoding frames; each beside a floor measured in the
// same run. Pin it: taskset -c 1 build/release/bin/dbc_benchmark
#include <array>
#include <bit>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include "drivers/can/can_frame.h"
#include "drivers/dbc/dbc_parser.h"
#include "drivers/dbc/message_codec.h"
#include "drivers/dbc/signal_codec.h"

namespace faultline {
namespace {

/// A DBC in the proportions of real cars' files: long names, a comment on every third signal, names
/// of values on every fourth, attributes, some multiplexed messages. 430 messages give 0.8 MB.
std::string make_car_dbc(int message_count) {
  std::mt19937 engine(20240611);
  const auto below = [&](unsigned limit) { return engine() % limit; };
  constexpr const char* kWords[] = {"Wheel",   "Speed",   "Torque", "Brake",  "Steering",
                                    "Angle",   "Request", "State",  "Actual", "Motor",
                                    "Battery", "Temp",    "Sensor", "Valid",  "Counter"};
  constexpr const char* kNodes[] = {"EngineControl", "Gateway", "BrakeSystem", "BodyDomain",
                                    "ADAS"};
  const auto name = [&](int n) {
    return fmt::format("{}{}{}_{}", kWords[below(15)], kWords[below(15)], kWords[below(15)], n);
  };
  std::string text = "VERSION \"\"\n\nNS_ :\n\tCM_\n\tBA_\n\tVAL_\n\nBS_:\n\nBU_:";
  for (const char* node : kNodes) text += fmt::format(" {}", node);
  text += "\n\n";
  std::string comments, values, attributes;
  for (int m = 0; m < message_count; ++m) {
    const bool is_extended = m >= 1500;
    const std::uint32_t id = is_extended ? 0x80010000u + static_cast<std::uint32_t>(m)
                                         : 0x100u + static_cast<std::uint32_t>(m);
    text += fmt::format("BO_ {} {}: 8 {}\n", id, name(m), kNodes[below(5)]);
    comments += fmt::format("CM_ BO_ {} \"Sent by the {} every {} ms\";\n", id, kWords[below(15)],
                            10 * (1 + below(10)));
    attributes += fmt::format("BA_ \"GenMsgCycleTime\" BO_ {} {};\n", id, 10 * (1 + below(10)));
    const int signal_count = 12;
    const bool is_multiplexed = m % 10 == 0;
    for (int s = 0; s < signal_count; ++s) {
      const std::string signal = name(s);
      const char* mark = !is_multiplexed ? "" : s == 0 ? " M" : s % 2 == 0 ? " m0" : " m1";
      const int start = 4 * s;
      const bool is_motorola = below(2) == 0;
      text += fmt::format(" SG_ {}{} : {}|{}@{}{} ({},{}) [{}|{}] \"{}\" {},{}\n", signal, mark,
                          is_motorola ? start + 3 : start, 4, is_motorola ? 0 : 1,
                          below(4) == 0 ? '-' : '+', below(2) == 0 ? "1" : "0.0625",
                          below(3) == 0 ? "-40" : "0", 0, below(1000), below(2) == 0 ? "km/h" : "",
                          kNodes[below(5)], kNodes[below(5)]);
      if (below(3) == 0) {
        comments += fmt::format(
            "CM_ SG_ {} {} \"The {} of the {} as the {} sees it, filtered with 10 Hz\";\n", id,
            signal, kWords[below(15)], kWords[below(15)], kWords[below(15)]);
      }
      if (below(4) == 0) {
        values += fmt::format(
            "VAL_ {} {} 0 \"Not_Available\" 1 \"Active\" 2 \"Fault\" 3 \"Reserved\" ;\n", id,
            signal);
      }
      if (below(4) == 0) {
        attributes += fmt::format("BA_ \"GenSigStartValue\" SG_ {} {} {};\n", id, signal, below(9));
      }
    }
    text += '\n';
  }
  text += comments;
  text +=
      "BA_DEF_ BO_ \"GenMsgCycleTime\" INT 0 65535;\n"
      "BA_DEF_ SG_ \"GenSigStartValue\" FLOAT 0 100;\n"
      "BA_DEF_DEF_ \"GenMsgCycleTime\" 0;\nBA_DEF_DEF_ \"GenSigStartValue\" 0;\n";
  return text + attributes + values;
}

void report_bytes(benchmark::State& state, const std::string& text) {
  state.SetBytesProcessed(static_cast<std::int64_t>(text.size()) * state.iterations());
  state.counters["MB"] = static_cast<double>(text.size()) / 1e6;
}

void parse_car(benchmark::State& state) {
  const std::string text = make_car_dbc(static_cast<int>(state.range(0)));
  std::size_t warnings = 0;
  for (auto _ : state) {
    const DbcDatabase dbc = parse_dbc(text, "car.dbc");
    warnings = dbc.warnings.size();
    benchmark::DoNotOptimize(dbc.messages.data());
  }
  report_bytes(state, text);
  state.counters["warnings"] = static_cast<double>(warnings);
}
BENCHMARK(parse_car)->Arg(430)->Arg(5400)->Unit(benchmark::kMillisecond);

/// The floor of any parser: finding the lines.
void find_lines(benchmark::State& state) {
  const std::string text = make_car_dbc(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    std::size_t lines = 0;
    const char* at = text.data();
    const char* const end = at + text.size();
    while ((at = static_cast<const char*>(
                std::memchr(at, '\n', static_cast<std::size_t>(end - at)))) != nullptr) {
      ++at;
      ++lines;
    }
    benchmark::DoNotOptimize(lines);
  }
  report_bytes(state, text);
}
BENCHMARK(find_lines)->Arg(430)->Arg(5400)->Unit(benchmark::kMillisecond);

/// The floor of a parser that looks at each byte once: counting words.
void count_words(benchmark::State& state) {
  const std::string text = make_car_dbc(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    std::size_t words = 0;
    bool is_in_word = false;
    for (const char c : text) {
      const bool is_blank = c == ' ' || c == '\n';
      words += is_in_word && is_blank ? 1 : 0;
      is_in_word = !is_blank;
    }
    benchmark::DoNotOptimize(words);
  }
  report_bytes(state, text);
}
BENCHMARK(count_words)->Arg(430)->Arg(5400)->Unit(benchmark::kMillisecond);

enum Layout { kIntel, kMotorola, kMixed };

/// Four signals of 16 bits: signed and unsigned, with factors and offsets.
DbcMessage four_signals(Layout layout) {
  DbcMessage message;
  message.name = "Four";
  message.length = 8;
  for (std::uint16_t n = 0; n < 4; ++n) {
    DbcSignal signal;
    signal.name = "s" + std::to_string(n);
    const bool is_motorola = layout == kMotorola || (layout == kMixed && n % 2 == 1);
    signal.byte_order = is_motorola ? ByteOrder::kBigEndian : ByteOrder::kLittleEndian;
    signal.start_bit = static_cast<std::uint16_t>(16 * n + (is_motorola ? 7 : 0));
    signal.bit_count = 16;
    signal.type = n < 2 ? SignalType::kSigned : SignalType::kUnsigned;
    signal.factor = n % 2 == 0 ? 0.01 : 0.0625;
    signal.offset = n == 3 ? -40.0 : 0.0;
    message.signals.push_back(signal);
  }
  return message;
}

CanFrame some_frame() {
  CanFrame frame;
  frame.length = 8;
  for (std::uint8_t n = 0; n < 8; ++n) frame.data[n] = static_cast<std::uint8_t>(37 * n + 11);
  return frame;
}

std::uint16_t little(const std::uint8_t* bytes) {
  return static_cast<std::uint16_t>(bytes[0] | bytes[1] << 8);
}
std::uint16_t big(const std::uint8_t* bytes) {
  return static_cast<std::uint16_t>(bytes[1] | bytes[0] << 8);
}

/// What one writes by hand for this one message: the same bounds check, plain double arithmetic.
template <Layout layout>
[[gnu::noinline]] std::size_t decode_by_hand(std::span<const std::uint8_t> payload,
                                             std::span<double> values) noexcept {
  if (payload.size() < 8 || values.size() < 4) return 0;
  const std::uint8_t* const p = payload.data();
  const auto word = [p](int n) {
    const bool is_big = layout == kMotorola || (layout == kMixed && n % 2 == 1);
    return is_big ? big(p + 2 * n) : little(p + 2 * n);
  };
  values[0] = static_cast<std::int16_t>(word(0)) * 0.01 + 0.0;
  values[1] = static_cast<std::int16_t>(word(1)) * 0.0625 + 0.0;
  values[2] = word(2) * 0.01 + 0.0;
  values[3] = word(3) * 0.0625 + -40.0;
  return 4;
}

template <Layout layout>
void decode_four_by_hand(benchmark::State& state) {
  CanFrame frame = some_frame();
  std::array<double, 4> values{};
  for (auto _ : state) {
    benchmark::DoNotOptimize(frame);
    benchmark::DoNotOptimize(decode_by_hand<layout>(frame.payload(), values));
    benchmark::DoNotOptimize(values);
  }
}
BENCHMARK(decode_four_by_hand<kIntel>);
BENCHMARK(decode_four_by_hand<kMotorola>);
BENCHMARK(decode_four_by_hand<kMixed>);

template <Layout layout>
void decode_four(benchmark::State& state) {
  const MessageCodec codec(four_signals(layout));
  CanFrame frame = some_frame();
  std::array<double, 4> values{};
  std::array<SignalPresence, 4> presence{};
  for (auto _ : state) {
    benchmark::DoNotOptimize(frame);
    benchmark::DoNotOptimize(codec.decode(frame.payload(), values, presence));
    benchmark::DoNotOptimize(values);
    benchmark::DoNotOptimize(presence);
  }
}
BENCHMARK(decode_four<kIntel>);
BENCHMARK(decode_four<kMotorola>);
BENCHMARK(decode_four<kMixed>);

/// The same through four SignalCodecs.
void decode_four_one_by_one(benchmark::State& state) {
  std::vector<SignalCodec> codecs;
  for (const DbcSignal& signal : four_signals(kMixed).signals) codecs.emplace_back(signal);
  CanFrame frame = some_frame();
  std::array<double, 4> values{};
  for (auto _ : state) {
    benchmark::DoNotOptimize(frame);
    for (std::size_t n = 0; n < codecs.size(); ++n) {
      benchmark::DoNotOptimize(codecs[n].decode_physical(frame.payload(), values[n]));
    }
    benchmark::DoNotOptimize(values);
  }
}
BENCHMARK(decode_four_one_by_one);

void encode_four(benchmark::State& state) {
  const MessageCodec codec(four_signals(kMixed));
  CanFrame frame = some_frame();
  std::array<double, 4> values{1.5, -2.25, 300.0, 12.5};
  for (auto _ : state) {
    benchmark::DoNotOptimize(values);
    benchmark::DoNotOptimize(codec.encode(values, std::span(frame.data).first(8)));
    benchmark::DoNotOptimize(frame);
  }
}
BENCHMARK(encode_four);

/// 64 bytes of CAN FD, 32 signals.
void decode_fd_message(benchmark::State& state) {
  DbcMessage message;
  message.length = 64;
  for (std::uint16_t n = 0; n < 32; ++n) {
    DbcSignal signal = four_signals(kMixed).signals[n % 4];
    signal.start_bit = static_cast<std::uint16_t>(16 * n + signal.start_bit % 16);
    message.signals.push_back(signal);
  }
  const MessageCodec codec(message);
  CanFrame frame = some_frame();
  frame.length = 64;
  std::array<double, 32> values{};
  std::array<SignalPresence, 32> presence{};
  for (auto _ : state) {
    benchmark::DoNotOptimize(frame);
    benchmark::DoNotOptimize(codec.decode(frame.payload(), values, presence));
    benchmark::DoNotOptimize(values);
  }
}
BENCHMARK(decode_fd_message);

}  // namespace
}  // namespace faultline

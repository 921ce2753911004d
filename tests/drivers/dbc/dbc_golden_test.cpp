// Every frame of tests/golden/dbc/golden.txt, made by an independent script in exact rationals.
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "drivers/dbc/dbc_parser.h"
#include "drivers/dbc/message_codec.h"
#include "drivers/dbc/signal_codec.h"

namespace faultline {
namespace {

const std::filesystem::path kFolder = FAULTLINE_GOLDEN_DIR "/dbc";
constexpr double kTolerance = 1e-12;  // of the value: what the project promises

struct GoldenValue {
  std::uint64_t raw = 0;
  double value = 0.0;
};

struct GoldenFrame {
  std::string file, message, payload_hex;
  std::vector<std::uint8_t> payload;
  std::map<std::string, GoldenValue> values;
};

std::vector<std::uint8_t> from_hex(const std::string& hex) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t n = 0; n + 1 < hex.size(); n += 2) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoul(hex.substr(n, 2), nullptr, 16)));
  }
  return bytes;
}

std::vector<GoldenFrame> read_golden() {
  std::ifstream stream(kFolder / "golden.txt");
  std::vector<GoldenFrame> frames;
  std::string line;
  while (std::getline(stream, line)) {
    std::istringstream words(line);
    std::string kind;
    words >> kind;
    if (kind == "frame") {
      GoldenFrame& frame = frames.emplace_back();
      words >> frame.file >> frame.message >> frame.payload_hex;
      frame.payload = from_hex(frame.payload_hex);
    } else {
      std::string signal, value;
      GoldenValue golden;
      words >> signal >> golden.raw >> value;
      golden.value = std::stod(value);
      frames.back().values[signal] = golden;
    }
  }
  return frames;
}

class DbcGolden : public testing::Test {
 protected:
  /// The script reads files as Latin-1 and writes names in UTF-8, as the parser does.
  const DbcMessage& message_of(const GoldenFrame& frame) {
    auto found = databases_.find(frame.file);
    if (found == databases_.end()) {
      found = databases_.emplace(frame.file, read_dbc(kFolder / frame.file)).first;
    }
    const DbcMessage* const message = found->second.find_message(frame.message);
    if (message == nullptr) throw std::runtime_error("no message " + frame.message);
    return *message;
  }

  std::map<std::string, DbcDatabase> databases_;
  const std::vector<GoldenFrame> frames_ = read_golden();
};

TEST_F(DbcGolden, DecodesEveryFrameToTheExactValue) {
  ASSERT_GT(frames_.size(), 600u);
  std::size_t checked = 0;
  for (const GoldenFrame& frame : frames_) {
    SCOPED_TRACE(frame.file + " " + frame.message + " " + frame.payload_hex);
    const DbcMessage& message = message_of(frame);
    const MessageCodec codec(message);
    // A copy of exactly its size, so that a read beyond the end shows under ASan.
    const std::vector<std::uint8_t> payload(frame.payload);
    std::vector<double> values(message.signals.size(), 4.2);
    std::vector<SignalPresence> presence(message.signals.size());
    std::size_t expected_count = 0;
    const std::size_t count = codec.decode(payload, values, presence);
    for (std::size_t n = 0; n < message.signals.size(); ++n) {
      const DbcSignal& signal = message.signals[n];
      SCOPED_TRACE(signal.name);
      const auto golden = frame.values.find(signal.name);
      if (golden == frame.values.end()) {
        EXPECT_NE(presence[n], SignalPresence::kPresent);
        EXPECT_EQ(values[n], 4.2);
        continue;
      }
      ++checked;
      if (!std::isfinite(golden->second.value)) {
        EXPECT_EQ(presence[n], SignalPresence::kNotANumber);
        continue;
      }
      ++expected_count;
      EXPECT_EQ(presence[n], SignalPresence::kPresent);
      EXPECT_LE(std::abs(values[n] - golden->second.value),
                kTolerance * std::abs(golden->second.value))
          << values[n] << " instead of " << golden->second.value;
      // One signal at a time gives the same bits.
      double alone = 0.0;
      EXPECT_EQ(SignalCodec(signal).decode_physical(payload, alone), CodecStatus::kOk);
      EXPECT_EQ(alone, values[n]);
      std::int64_t raw = 0;
      EXPECT_EQ(SignalCodec(signal).decode_raw(payload, raw), CodecStatus::kOk);
      const std::uint64_t mask = ~std::uint64_t{0} >> (64 - signal.bit_count);
      EXPECT_EQ(static_cast<std::uint64_t>(raw) & mask, golden->second.raw);
    }
    EXPECT_EQ(count, expected_count);
  }
  EXPECT_GT(checked, 2000u);
}

/// True if each raw value of `signal` has a double of its own.
bool is_exact(const DbcSignal& signal) {
  const double raw_range = std::ldexp(1.0, signal.bit_count);
  const bool is_float = signal.type == SignalType::kFloat32 || signal.type == SignalType::kFloat64;
  if (is_float) return signal.offset == 0.0 && signal.factor == 1.0;
  return raw_range + std::abs(signal.offset / signal.factor) < 0x1p52;
}

TEST_F(DbcGolden, EncodesTheValuesOfEveryFrameBackToItsPayload) {
  std::size_t checked = 0;
  for (const GoldenFrame& frame : frames_) {
    SCOPED_TRACE(frame.file + " " + frame.message + " " + frame.payload_hex);
    const DbcMessage& message = message_of(frame);
    const MessageCodec codec(message);
    std::vector<double> values(message.signals.size(), std::nan(""));
    std::vector<SignalPresence> presence(message.signals.size());
    codec.decode(frame.payload, values, presence);
    // All bits of the signals turned over, so that encoding has to write each of them.
    std::vector<std::uint8_t> payload = frame.payload;
    for (std::size_t n = 0; n < values.size(); ++n) {
      if (presence[n] != SignalPresence::kPresent) continue;
      const SignalCodec one(message.signals[n]);
      std::int64_t raw = 0;
      ASSERT_EQ(one.decode_raw(frame.payload, raw), CodecStatus::kOk);
      if (!is_exact(message.signals[n])) {
        values[n] = std::nan("");
        continue;
      }
      ASSERT_EQ(one.encode_raw(payload, ~raw), CodecStatus::kOk);
      ++checked;
    }
    codec.encode(values, payload);
    EXPECT_EQ(payload, frame.payload);
  }
  EXPECT_GT(checked, 1800u);
}

std::size_t count_of(const DbcDatabase& dbc, DbcSeverity severity) {
  std::size_t count = 0;
  for (const DbcWarning& warning : dbc.warnings) count += warning.severity == severity ? 1u : 0u;
  return count;
}

TEST_F(DbcGolden, FindsErrorsOnlyInTheFileThatHasThem) {
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(kFolder)) {
    if (entry.path().extension() != ".dbc") continue;
    ++files;
    const std::size_t errors = count_of(read_dbc(entry.path()), DbcSeverity::kError);
    // Two strings without end, a message, garbage, an attribute's value and a comment.
    EXPECT_EQ(errors, entry.path().filename() == "broken_lines.dbc" ? 6u : 0u) << entry.path();
  }
  EXPECT_EQ(files, 13u);
}

TEST_F(DbcGolden, KeepsWhatIsSoundInABrokenFile) {
  const DbcDatabase dbc = read_dbc(kFolder / "broken_lines.dbc");
  ASSERT_EQ(dbc.messages.size(), 2u);
  const DbcMessage& good = dbc.messages[0];
  ASSERT_EQ(good.signals.size(), 3u);
  EXPECT_EQ(good.comment, "never closed");
  EXPECT_EQ(good.signals[0].comment, "closed");
  EXPECT_EQ(good.signals[0].value_names.size(), 2u);
  EXPECT_EQ(good.signals[2].value_names.size(), 3u);
  EXPECT_EQ(good.attributes.at("GenMsgCycleTime"), DbcAttributeValue(std::int64_t{100}));
  EXPECT_EQ(dbc.messages[1].id, 12u);
  EXPECT_EQ(dbc.messages[1].length, 8);
  EXPECT_EQ(dbc.messages[1].signals.at(0).start_bit, 10);
}

TEST_F(DbcGolden, KeepsTextsOfEveryEncoding) {
  const DbcDatabase dbc = read_dbc(kFolder / "windows1252.dbc");
  EXPECT_EQ(dbc.version, "gr\u00fc\u00df");
  EXPECT_EQ(dbc.nodes.at(1), "T\u00fcr");
  EXPECT_EQ(dbc.messages.at(0).find_signal("Preis")->unit, "\u20ac");
  EXPECT_EQ(dbc.messages[0].find_signal("Preis")->comment, "in \u20ac \u2013 netto");
  EXPECT_NE(dbc.messages[0].find_signal("K\u00fchlmittel"), nullptr);
}

}  // namespace
}  // namespace faultline

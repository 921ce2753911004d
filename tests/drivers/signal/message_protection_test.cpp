#include "drivers/signal/message_protection.h"

#include <cstdint>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "drivers/dbc/dbc_parser.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

constexpr std::string_view kAttributes =
    "BA_DEF_ SG_ \"FaultlineRole\" ENUM \"none\",\"sync\",\"cycle\",\"command_cycle\",\"alive\","
    "\"crc\",\"data_id_nibble\";\n"
    "BA_DEF_ BO_ \"FaultlineProtection\" ENUM \"none\",\"J1850\",\"E2E_P01A\",\"E2E_P01B\","
    "\"E2E_P01C\",\"E2E_P02\",\"E2E_P05\",\"E2E_P07\";\n"
    "BA_DEF_ BO_ \"FaultlineDataId\" INT 0 65535;\n"
    "BA_DEF_ BO_ \"FaultlineDataIdList\" STRING ;\n"
    "BA_DEF_ BO_ \"FaultlineBus\" INT 0 255;\n"
    "BA_DEF_DEF_ \"FaultlineRole\" \"none\";\n"
    "BA_DEF_DEF_ \"FaultlineProtection\" \"none\";\n"
    "BA_DEF_DEF_ \"FaultlineDataId\" 0;\n"
    "BA_DEF_DEF_ \"FaultlineDataIdList\" \"\";\n";

/// Message "M" with id 1: `signals` and the attributes that follow them.
DbcDatabase message(unsigned length, const std::string& signals, const std::string& attributes) {
  return parse_dbc(fmt::format("BO_ 1 M: {} N\n{}{}{}", length, signals, kAttributes, attributes),
                   "m.dbc");
}

std::string role(std::string_view signal, std::string_view role) {
  return fmt::format("BA_ \"FaultlineRole\" SG_ 1 {} \"{}\";\n", signal, role);
}

const std::string kSignals =
    " SG_ crc : 0|8@1+ (1,0) [0|255] \"\" N\n"
    " SG_ n : 8|4@1+ (1,0) [0|14] \"\" N\n"
    " SG_ nibble : 12|4@1+ (1,0) [0|15] \"\" N\n"
    " SG_ wide : 16|16@1+ (1,0) [0|0] \"\" N\n"
    " SG_ f : 32|32@1- (1,0) [0|0] \"\" N\n";
const std::string kFloat = "SIG_VALTYPE_ 1 f : 1;\n";
const std::string kCrc = role("crc", "crc");
const std::string kAlive = role("n", "alive");
const std::string kNibble = role("nibble", "data_id_nibble");
const std::string kId = "BA_ \"FaultlineDataId\" BO_ 1 291;\n";
const std::string kIds =
    "BA_ \"FaultlineDataIdList\" BO_ 1 \"000102030405060708090A0b0c0D0e0F\";\n";

std::string protection(std::string_view profile) {
  return fmt::format("BA_ \"FaultlineProtection\" BO_ 1 \"{}\";\n", profile);
}

MessageProtection compiled(const DbcDatabase& dbc) {
  return compile_protection(dbc, dbc.messages.front());
}

std::string error_of(const DbcDatabase& dbc) {
  try {
    static_cast<void>(compiled(dbc));
  } catch (const ProtectionError& error) {
    return error.what();
  }
  return "no error";
}

std::string error_of(const std::string& attributes) {
  return error_of(message(8, kSignals, kFloat + attributes));
}

std::vector<std::uint8_t> bytes_of_hex(const std::string& text) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoul(text.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

/// A case of tests/golden/e2e.
struct GoldenCase {
  std::string profile;
  int length = 0, crc_byte = 0, alive_bit = 0, nibble_bit = 0, data_id = 0, counter = 0;
  std::string data_ids, payload, is_protected;
};

std::vector<GoldenCase> golden_cases() {
  std::ifstream file(std::string(FAULTLINE_GOLDEN_DIR) + "/e2e/cases.txt");
  std::vector<GoldenCase> cases;
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("#")) continue;
    std::istringstream in(line);
    GoldenCase& c = cases.emplace_back();
    in >> c.profile >> c.length >> c.crc_byte >> c.alive_bit >> c.nibble_bit >> c.data_id >>
        c.data_ids >> c.counter >> c.payload >> c.is_protected;
  }
  return cases;
}

/// The same description in a DBC.
MessageProtection protection_of(const GoldenCase& c) {
  const bool is_wide = c.profile == "E2E_P05";
  std::string signals =
      fmt::format(" SG_ crc : {}|{}@1+ (1,0) [0|0] \"\" N\n", 8 * c.crc_byte, is_wide ? 16 : 8);
  std::string attributes = kCrc + protection(c.profile);
  if (c.alive_bit >= 0) {
    signals += fmt::format(" SG_ n : {}|{}@1+ (1,0) [0|0] \"\" N\n", c.alive_bit, is_wide ? 8 : 4);
    attributes += kAlive;
  }
  if (c.nibble_bit >= 0) {
    signals += fmt::format(" SG_ nibble : {}|4@1+ (1,0) [0|0] \"\" N\n", c.nibble_bit);
    attributes += kNibble;
  }
  if (c.profile == "E2E_P02") {
    attributes += fmt::format("BA_ \"FaultlineDataIdList\" BO_ 1 \"{}\";\n", c.data_ids);
  } else if (c.profile != "J1850") {
    attributes += fmt::format("BA_ \"FaultlineDataId\" BO_ 1 {};\n", c.data_id);
  }
  return compiled(message(static_cast<unsigned>(c.length), signals, attributes));
}

TEST(MessageProtection, WritesWhatTheSpecificationsAlgorithmWrites) {
  const std::vector<GoldenCase> cases = golden_cases();
  ASSERT_EQ(cases.size(), 360U);
  for (const GoldenCase& c : cases) {
    const MessageProtection protection = protection_of(c);
    std::vector<std::uint8_t> payload = bytes_of_hex(c.payload);
    protection.write(payload, static_cast<std::uint64_t>(c.counter));
    EXPECT_EQ(payload, bytes_of_hex(c.is_protected)) << c.profile << " " << c.payload;
    EXPECT_TRUE(protection.is_crc_right(payload));
    if (protection.has_counter()) {
      EXPECT_EQ(protection.count(payload), static_cast<std::uint64_t>(c.counter));
    }
  }
}

/// Flips `width` bits from `first` on, as they are on the wire: the first, the last, and those of
/// `inner` between.
void flip_burst(std::vector<std::uint8_t>& payload, std::size_t first, std::size_t width,
                std::uint32_t inner) {
  for (std::size_t n = 0; n < width; ++n) {
    const bool is_end = n == 0 || n + 1 == width;
    if (!is_end && (inner >> n & 1) == 0) continue;
    const std::size_t bit = first + n;
    payload[bit / 8] = static_cast<std::uint8_t>(payload[bit / 8] ^ (0x80 >> bit % 8));
  }
}

// Every polynomial of degree 8 or 16 finds bursts of up to 8 bits in what it covers.
TEST(MessageProtection, FindsEveryFlippedBitAndEveryBurstOfUpToEightBits) {
  constexpr std::size_t kWidestBurst = 8;
  const std::uint64_t seed = test_seed(1);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937 draw(static_cast<std::uint32_t>(seed));
  for (const GoldenCase& c : golden_cases()) {
    const MessageProtection protection = protection_of(c);
    const std::vector<std::uint8_t> payload = bytes_of_hex(c.is_protected);
    const auto crc_begin = 8 * static_cast<std::size_t>(c.crc_byte);
    const std::size_t crc_end = crc_begin + (c.profile == "E2E_P05" ? 16 : 8);
    for (std::size_t first = 0; first < 8 * payload.size(); ++first) {
      const std::size_t width = 1 + draw() % kWidestBurst;
      const std::size_t end = first + width;
      // Across the checksum's edge the bits are not next to each other in the polynomial.
      const bool is_across =
          (first < crc_begin && end > crc_begin) || (first < crc_end && end > crc_end);
      if (end > 8 * payload.size() || is_across) continue;
      std::vector<std::uint8_t> broken = payload;
      flip_burst(broken, first, width, static_cast<std::uint32_t>(draw()));
      // 1B and 2 choose the data id by the counter: with another id the checksum is another.
      const bool has_other_id = (c.profile == "E2E_P01B" || c.profile == "E2E_P02") &&
                                protection.count(broken) != protection.count(payload);
      if (has_other_id) continue;
      EXPECT_FALSE(protection.is_crc_right(broken)) << c.profile << " " << first << " " << width;
    }
  }
}

TEST(MessageProtection, ChecksTheNibbleOfTheDataId) {
  const std::string attributes = kCrc + kAlive + kNibble + kId + protection("E2E_P01C");
  const MessageProtection ours = compiled(message(8, kSignals, kFloat + attributes));
  std::vector<std::uint8_t> payload(8);
  ours.write(payload, 0);
  EXPECT_EQ(payload, bytes_of_hex("2a10000000000000"));
  EXPECT_TRUE(ours.is_crc_right(payload));
  // A message whose id differs in the nibble alone has a checksum that is right for its payload.
  MessageProtection other = ours;
  other.data_id = 0x223;
  other.write(payload, 0);
  EXPECT_TRUE(other.is_crc_right(payload));
  EXPECT_FALSE(ours.is_crc_right(payload));
}

TEST(MessageProtection, TakesACounterAloneOfAnyWidth) {
  for (const unsigned bits : {1U, 2U, 7U, 16U, 33U, 63U, 64U}) {
    for (const char order : {'0', '1'}) {
      const unsigned start = order == '0' ? 7U : 0U;
      const std::string signal =
          fmt::format(" SG_ n : {}|{}@{}+ (1,0) [0|0] \"\" N\n", start, bits, order);
      const MessageProtection protection = compiled(message(8, signal, kAlive));
      EXPECT_FALSE(protection.has_crc());
      ASSERT_TRUE(protection.has_counter());
      EXPECT_EQ(protection.last_count, ~std::uint64_t{0} >> (64 - bits));
      std::vector<std::uint8_t> payload(8, 0);
      protection.write(payload, protection.last_count);
      EXPECT_EQ(protection.count(payload), protection.last_count);
    }
  }
}

TEST(MessageProtection, TakesTheEndOfTheSequenceFromTheSignalsMaximum) {
  const auto last = [](const std::string& range) {
    return compiled(message(8, " SG_ n : 0|4@1+ (1,0) " + range + " \"\" N\n", kAlive)).last_count;
  };
  EXPECT_EQ(last("[0|14]"), 14U);
  EXPECT_EQ(last("[0|9]"), 9U);
  EXPECT_EQ(last("[0|15]"), 15U);
  EXPECT_EQ(last("[0|100]"), 15U);
  EXPECT_EQ(last("[0|0]"), 15U);   // not given
  EXPECT_EQ(last("[1|14]"), 15U);  // not from 0 on: no sequence we know
}

TEST(MessageProtection, CountsASignedCounterByItsBits) {
  const MessageProtection protection =
      compiled(message(8, " SG_ n : 0|4@1- (1,0) [-8|7] \"\" N\n", kAlive));
  EXPECT_EQ(protection.last_count, 15U);
  std::vector<std::uint8_t> payload(8, 0xFF);
  EXPECT_EQ(protection.count(payload), 15U);
}

TEST(MessageProtection, IsNoneWithoutAttributes) {
  EXPECT_TRUE(compiled(message(8, kSignals, kFloat)).is_none());
  EXPECT_TRUE(compiled(parse_dbc("BO_ 1 M: 300 N\n" + kSignals, "m.dbc")).is_none());
}

TEST(MessageProtectionErrors, TellOfAnUnknownProfile) {
  EXPECT_EQ(
      error_of(protection("E2E_P07")),
      "m.dbc:1:5: message M: found FaultlineProtection \"E2E_P07\", expected one of \"none\", "
      "\"J1850\", \"E2E_P01A\", \"E2E_P01B\", \"E2E_P01C\", \"E2E_P02\", \"E2E_P05\"");
}

TEST(MessageProtectionErrors, TellOfAMissingSignal) {
  EXPECT_EQ(error_of(protection("J1850")),
            "m.dbc:1:5: message M: protection J1850 needs a signal of role crc, found none");
  EXPECT_EQ(error_of(kCrc + kId + protection("E2E_P01A")),
            "m.dbc:1:5: message M: protection E2E_P01A needs a signal of role alive, found none");
  EXPECT_EQ(error_of(kCrc + kAlive + kId + protection("E2E_P01C")),
            "m.dbc:1:5: message M: protection E2E_P01C needs a signal of role data_id_nibble, "
            "found none");
}

TEST(MessageProtectionErrors, TellOfASignalThatHasNothingToDo) {
  EXPECT_EQ(error_of(kCrc),
            "m.dbc:2:6: signal M.crc has the role crc, and its message FaultlineProtection none, "
            "expected one that says how it is made");
  EXPECT_EQ(error_of(kCrc + kAlive + kNibble + kId + protection("E2E_P01A")),
            "m.dbc:4:6: signal M.nibble has the role data_id_nibble, and its message "
            "FaultlineProtection E2E_P01A, expected E2E_P01C");
}

TEST(MessageProtectionErrors, TellOfARoleTwice) {
  EXPECT_EQ(error_of(kAlive + role("nibble", "alive")),
            "m.dbc:4:6: message M has two signals of role alive, expected one");
}

TEST(MessageProtectionErrors, TellOfAWrongWidth) {
  EXPECT_EQ(error_of(role("wide", "crc") + protection("J1850")),
            "m.dbc:5:6: role crc: signal M.wide has 16 bits, expected 8 with J1850");
  EXPECT_EQ(error_of(kCrc + kAlive + kId + protection("E2E_P05")),
            "m.dbc:3:6: role alive: signal M.n has 4 bits, expected 8 with E2E_P05");
  EXPECT_EQ(error_of(kCrc + role("wide", "alive") + kIds + protection("E2E_P02")),
            "m.dbc:5:6: role alive: signal M.wide has 16 bits, expected 4 with E2E_P02");
}

TEST(MessageProtectionErrors, TellOfAFloat) {
  EXPECT_EQ(error_of(role("f", "alive")),
            "m.dbc:6:6: role alive: signal M.f is a float, expected an integer");
}

TEST(MessageProtectionErrors, TellOfAChecksumThatFillsNoWholeBytes) {
  EXPECT_EQ(
      error_of(message(8, " SG_ crc : 4|8@1+ (1,0) [0|0] \"\" N\n", kCrc + protection("J1850"))),
      "m.dbc:2:6: role crc: signal M.crc begins at bit 4 of a byte, expected it to fill "
      "whole bytes");
  EXPECT_EQ(error_of(message(8,
                             " SG_ crc : 7|16@0+ (1,0) [0|0] \"\" N\n"
                             " SG_ n : 16|8@1+ (1,0) [0|0] \"\" N\n",
                             kCrc + kAlive + kId + protection("E2E_P05"))),
            "m.dbc:2:6: role crc: signal M.crc is big-endian, expected little-endian (@1) with "
            "E2E_P05");
}

TEST(MessageProtectionErrors, TellOfSignalsThatOverlapOrLieBeyond) {
  EXPECT_EQ(error_of(message(8,
                             " SG_ crc : 0|8@1+ (1,0) [0|0] \"\" N\n"
                             " SG_ n : 11|5@0+ (1,0) [0|0] \"\" N\n"
                             " SG_ o : 7|5@0+ (1,0) [0|0] \"\" N\n",
                             kCrc + role("o", "alive") + protection("J1850"))),
            "m.dbc:4:6: signal M.o overlaps M.crc");
  EXPECT_EQ(error_of(message(1, kSignals, kFloat + kAlive)),
            "m.dbc:3:6: signal M.n of 4 bits needs 2 bytes, its message has 1");
  EXPECT_EQ(error_of(message(
                8, " SG_ s M : 8|8@1+ (1,0) [0|0] \"\" N\n SG_ n m1 : 0|4@1+ (1,0) [0|0] \"\" N\n",
                kAlive)),
            "m.dbc:3:6: signal M.n is multiplexed, expected one that every frame carries");
}

TEST(MessageProtectionErrors, TellOfAMissingOrImpossibleDataId) {
  EXPECT_EQ(error_of(kCrc + kAlive + protection("E2E_P01A")),
            "m.dbc:1:5: message M: protection E2E_P01A needs the attribute FaultlineDataId, found "
            "none of its own");
  EXPECT_EQ(error_of(kCrc + protection("J1850") + kId),
            "m.dbc:1:5: message M: found FaultlineDataId 291, expected none with "
            "FaultlineProtection J1850");
  EXPECT_EQ(error_of(kCrc + kAlive + kNibble + "BA_ \"FaultlineDataId\" BO_ 1 4096;\n" +
                     protection("E2E_P01C")),
            "m.dbc:1:5: message M: found FaultlineDataId 4096, expected an integer of 0 .. 4095");
  EXPECT_EQ(
      error_of(kCrc + kAlive + "BA_ \"FaultlineDataId\" BO_ 1 -1;\n" + protection("E2E_P01A")),
      "m.dbc:1:5: message M: found FaultlineDataId -1, expected an integer of 0 .. 65535");
}

TEST(MessageProtectionErrors, TellOfAListThatIsNoSixteenBytes) {
  const auto error = [](const std::string& list) {
    return error_of(kCrc + kAlive + list + protection("E2E_P02"));
  };
  EXPECT_EQ(error(""),
            "m.dbc:1:5: message M: found FaultlineDataIdList missing, expected 16 bytes as 32 "
            "hexadecimal digits");
  for (const char* const text :
       {"", "0011", "000102030405060708090A0b0c0D0e0G", "+00102030405060708090A0b0c0D0e0F",
        "000102030405060708090A0b0c0D0e0F0"}) {
    EXPECT_EQ(
        error(fmt::format("BA_ \"FaultlineDataIdList\" BO_ 1 \"{}\";\n", text)),
        fmt::format("m.dbc:1:5: message M: found FaultlineDataIdList \"{}\", expected 16 bytes "
                    "as 32 hexadecimal digits",
                    text));
  }
  EXPECT_EQ(error_of(kIds),
            "m.dbc:1:5: message M: found FaultlineDataIdList "
            "\"000102030405060708090A0b0c0D0e0F\", expected none without E2E_P02");
}

std::string text_of(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(MessageProtection, UnderstandsTheExampleOfItsDocumentation) {
  const std::string page = text_of(std::string(FAULTLINE_DOCS_DIR) + "/can_integrity.md");
  const std::size_t begin = page.find("```\nBO_");
  ASSERT_NE(begin, std::string::npos);
  const std::string snippet = page.substr(begin + 4, page.find("```", begin + 4) - begin - 4);
  const DbcDatabase dbc = parse_dbc(snippet, "can_integrity.md");
  ASSERT_EQ(dbc.messages.size(), 1U);
  const MessageProtection protection = compile_protection(dbc, dbc.messages[0]);
  EXPECT_EQ(protection.profile, ProtectionProfile::kE2eP01C);
  EXPECT_EQ(protection.data_id, 291);
  std::vector<std::uint8_t> payload(8);
  protection.write(payload, 0);
  EXPECT_EQ(payload, bytes_of_hex("2a10000000000000"));
}

// What people write into a DBC by mistake is refused, or describes something that works.
TEST(MessageProtection, SurvivesEveryDamagedDescription) {
  const std::uint64_t seed = test_seed(31);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 draw(seed);
  const std::string whole =
      text_of(std::string(FAULTLINE_EXAMPLES_DIR) + "/hou2015/bench_protected.dbc");
  ASSERT_GT(whole.size(), 1000U);
  int compiled_count = 0;
  int refused_count = 0;
  for (int round = 0; round < 3000; ++round) {
    std::string text = whole;
    for (auto damage = 1 + draw() % 4; damage > 0; --damage) {
      const std::size_t at = draw() % text.size();
      switch (draw() % 4) {
        case 0:
          text[at] = static_cast<char>('0' + draw() % 10);
          break;
        case 1:
          text[at] = static_cast<char>(draw());
          break;
        case 2:
          text.erase(at, draw() % 8);
          break;
        default:
          text.insert(at, std::string(1 + draw() % 3, static_cast<char>('0' + draw() % 10)));
      }
    }
    DbcDatabase dbc;
    try {
      dbc = parse_dbc(text, "damaged.dbc");
    } catch (const DbcError&) {
      continue;
    }
    for (const DbcMessage& one : dbc.messages) {
      try {
        const MessageProtection protection = compile_protection(dbc, one);
        std::vector<std::uint8_t> payload(protection.length);
        for (std::uint8_t& byte : payload) byte = static_cast<std::uint8_t>(draw());
        static_cast<void>(protection.is_crc_right(payload));
        const std::uint64_t count = protection.last_count == 0 ? 0 : draw() % protection.last_count;
        protection.write(payload, count);
        EXPECT_TRUE(protection.is_crc_right(payload));
        if (protection.has_counter()) {
          EXPECT_EQ(protection.count(payload), count);
        }
        ++compiled_count;
      } catch (const ProtectionError& error) {
        EXPECT_TRUE(std::string(error.what()).starts_with("damaged.dbc:"));
        ++refused_count;
      }
    }
  }
  EXPECT_GT(compiled_count, 1000);
  EXPECT_GT(refused_count, 100);
}

}  // namespace
}  // namespace faultline

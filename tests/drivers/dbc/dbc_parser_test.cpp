#include "drivers/dbc/dbc_parser.h"

#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <system_error>

#include <gtest/gtest.h>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

/// What a tool of the trade writes: every section we read, and some we do not.
constexpr std::string_view kBench = R"(VERSION "1.2"

NS_ :
	NS_DESC_
	CM_
	BA_DEF_
	BA_
	VAL_
	BA_DEF_DEF_
	SIG_VALTYPE_

BS_: 500000 : 1,2

BU_: Plant Controller
VAL_TABLE_ OnOff 1 "on" 0 "off" ;

BO_ 256 Outputs: 8 Plant
 SG_ y1 : 0|16@1- (0.01,-5) [-100|100] "V" Controller,Tester
 SG_ y2 : 23|16@0+ (1,0) [0|65535] "" Vector__XXX
 SG_ k : 60|4@1+ (1,0) [0|15] ""  Controller

BO_ 2147483904 Inputs: 16 Controller
 SG_ mux M : 0|8@1+ (1,0) [0|0] "" Plant
 SG_ u1 m0 : 8|32@1- (1,0) [0|0] "A" Plant
 SG_ u2 m1M : 8|8@1+ (2,0) [0|0] "A" Plant

BO_TX_BU_ 256 : Plant,Controller;
EV_ Env: 0 [0|1] "" 0 1 DUMMY_NODE_VECTOR0 Vector__XXX;

CM_ "the whole bench";
CM_ BU_ Plant "a tank
on two lines";
CM_ BO_ 256 "what is measured";
CM_ SG_ 256 y1 "with \"quotes\" and \\";
CM_ EV_ Env "ignored";
BA_DEF_ "Baudrate" INT 0 1000000;
BA_DEF_ BU_ "Station" HEX 0 255;
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","StandardCAN_FD";
BA_DEF_ SG_ "FaultlineRole" ENUM "none","sync","cycle","command_cycle","alive","crc";
BA_DEF_ SG_ "Delay" FLOAT 0 1;
BA_DEF_ SG_ "Note" STRING ;
BA_DEF_DEF_ "Baudrate" 500000;
BA_DEF_DEF_ "Station" 0;
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_DEF_DEF_ "FaultlineRole" "none";
BA_DEF_DEF_ "Delay" 0.5;
BA_DEF_DEF_ "Note" "";
BA_ "Baudrate" 250000;
BA_ "Station" BU_ Plant 7;
BA_ "VFrameFormat" BO_ 2147483904 2;
BA_ "FaultlineRole" SG_ 256 k 2;
BA_ "Delay" SG_ 256 y1 0.25;
BA_ "Note" SG_ 256 y1 "hello";
VAL_ 256 k 0 "zero" 15 "fifteen" ;
VAL_ Env 0 "a" ;
SIG_VALTYPE_ 2147483904 u1 : 1;
)";

DbcDatabase parse(std::string_view text) { return parse_dbc(text, "bench.dbc"); }

std::string error_of(std::string_view text) {
  try {
    static_cast<void>(parse(text));
  } catch (const DbcError& error) {
    return error.what();
  }
  return "no error";
}

/// A database with one signal of one message, as written in `signal`.
std::string with_signal(std::string_view signal, std::string_view rest = "") {
  return "BO_ 1 M: 8 N\n SG_ " + std::string(signal) + "\n" + std::string(rest);
}

TEST(DbcParser, ReadsVersionNodesAndMessages) {
  const DbcDatabase dbc = parse(kBench);
  EXPECT_EQ(dbc.source, "bench.dbc");
  EXPECT_EQ(dbc.version, "1.2");
  EXPECT_EQ(dbc.nodes, (std::vector<std::string>{"Plant", "Controller"}));
  ASSERT_EQ(dbc.messages.size(), 2u);
  const DbcMessage& outputs = dbc.messages[0];
  EXPECT_EQ(outputs.name, "Outputs");
  EXPECT_EQ(outputs.id, 256u);
  EXPECT_FALSE(outputs.is_extended);
  EXPECT_EQ(outputs.length, 8);
  EXPECT_EQ(outputs.transmitter, "Plant");
  EXPECT_EQ(outputs.signals.size(), 3u);
  EXPECT_EQ(outputs.position.line, 17);
  EXPECT_EQ(outputs.position.column, 5);
  const DbcMessage& inputs = dbc.messages[1];
  EXPECT_EQ(inputs.id, 256u);
  EXPECT_TRUE(inputs.is_extended);
  EXPECT_EQ(inputs.length, 16);
}

TEST(DbcParser, ReadsSignals) {
  const DbcDatabase dbc = parse(kBench);
  const DbcSignal* const y1 = dbc.find_message("Outputs")->find_signal("y1");
  ASSERT_NE(y1, nullptr);
  EXPECT_EQ(y1->start_bit, 0);
  EXPECT_EQ(y1->bit_count, 16);
  EXPECT_EQ(y1->byte_order, ByteOrder::kLittleEndian);
  EXPECT_EQ(y1->type, SignalType::kSigned);
  EXPECT_EQ(y1->factor, 0.01);
  EXPECT_EQ(y1->offset, -5.0);
  EXPECT_EQ(y1->minimum, -100.0);
  EXPECT_EQ(y1->maximum, 100.0);
  EXPECT_EQ(y1->unit, "V");
  EXPECT_EQ(y1->receivers, (std::vector<std::string>{"Controller", "Tester"}));
  EXPECT_EQ(y1->position.line, 18);
  EXPECT_EQ(y1->position.column, 6);
  const DbcSignal* const y2 = dbc.find_message("Outputs")->find_signal("y2");
  ASSERT_NE(y2, nullptr);
  EXPECT_EQ(y2->byte_order, ByteOrder::kBigEndian);
  EXPECT_EQ(y2->type, SignalType::kUnsigned);
}

TEST(DbcParser, ReadsMultiplexing) {
  const DbcDatabase dbc = parse(kBench);
  const DbcMessage& inputs = dbc.messages[1];
  EXPECT_TRUE(inputs.find_signal("mux")->is_multiplexer);
  EXPECT_EQ(inputs.find_signal("mux")->multiplexer, DbcSignal::kAlwaysPresent);
  EXPECT_FALSE(inputs.find_signal("u1")->is_multiplexer);
  EXPECT_EQ(inputs.find_signal("u1")->multiplexer_ranges.at(0).first, 0u);
  EXPECT_TRUE(inputs.find_signal("u2")->is_multiplexer);
  EXPECT_EQ(inputs.find_signal("u2")->multiplexer_ranges.at(0).first, 1u);
}

TEST(DbcParser, ReadsFloatTypesAndValueNames) {
  const DbcDatabase dbc = parse(kBench);
  EXPECT_EQ(dbc.messages[1].find_signal("u1")->type, SignalType::kFloat32);
  const auto& names = dbc.messages[0].find_signal("k")->value_names;
  ASSERT_EQ(names.size(), 2u);
  EXPECT_EQ(names[1].value, 15);
  EXPECT_EQ(names[1].name, "fifteen");
}

TEST(DbcParser, ReadsComments) {
  const DbcDatabase dbc = parse(kBench);
  EXPECT_EQ(dbc.comment, "the whole bench");
  EXPECT_EQ(dbc.node_comments.at("Plant"), "a tank\non two lines");
  EXPECT_EQ(dbc.messages[0].comment, "what is measured");
  EXPECT_EQ(dbc.messages[0].signals[0].comment, "with \"quotes\" and \\");
}

TEST(DbcParser, ReadsAttributesOfEveryObject) {
  const DbcDatabase dbc = parse(kBench);
  EXPECT_EQ(dbc.attributes.at("Baudrate"), DbcAttributeValue(std::int64_t{250000}));
  EXPECT_EQ(dbc.node_attributes.at("Plant").at("Station"), DbcAttributeValue(std::int64_t{7}));
  const DbcSignal& y1 = dbc.messages[0].signals[0];
  EXPECT_EQ(y1.attributes.at("Delay"), DbcAttributeValue(0.25));
  EXPECT_EQ(y1.attributes.at("Note"), DbcAttributeValue(std::string("hello")));
}

TEST(DbcParser, ResolvesEnumerationsToTheirText) {
  const DbcDatabase dbc = parse(kBench);
  EXPECT_EQ(dbc.messages[1].attributes.at("VFrameFormat"),
            DbcAttributeValue(std::string("StandardCAN_FD")));
  EXPECT_EQ(dbc.messages[0].find_signal("k")->attributes.at("FaultlineRole"),
            DbcAttributeValue(std::string("cycle")));
}

TEST(DbcParser, FallsBackToDefaultsWhenAnAttributeIsLookedUp) {
  const DbcDatabase dbc = parse(kBench);
  const DbcMessage& outputs = dbc.messages[0];
  ASSERT_NE(dbc.attribute_of(outputs, "VFrameFormat"), nullptr);
  EXPECT_EQ(*dbc.attribute_of(outputs, "VFrameFormat"),
            DbcAttributeValue(std::string("StandardCAN")));
  EXPECT_EQ(*dbc.attribute_of(outputs.signals[0], "FaultlineRole"),
            DbcAttributeValue(std::string("none")));
  EXPECT_EQ(*dbc.attribute_of(outputs.signals[2], "FaultlineRole"),
            DbcAttributeValue(std::string("cycle")));
  EXPECT_EQ(dbc.attribute_of(outputs, "Nonsense"), nullptr);
}

TEST(DbcParser, WarnsOfSectionsItDoesNotRead) {
  const DbcDatabase dbc = parse(kBench);
  ASSERT_EQ(dbc.warnings.size(), 4u);
  EXPECT_EQ(dbc.warnings[0].text, "section VAL_TABLE_ is not read");
  EXPECT_EQ(dbc.warnings[0].position.line, 15);
  EXPECT_EQ(dbc.warnings[0].position.column, 1);
  EXPECT_EQ(dbc.warnings[1].text, "section BO_TX_BU_ is not read");
  EXPECT_EQ(dbc.warnings[2].text, "section EV_ is not read");
  EXPECT_EQ(dbc.warnings[3].text, "value names of environment variable Env are not read");
}

TEST(DbcParser, ReadsAnEmptyFile) {
  EXPECT_TRUE(parse("").messages.empty());
  EXPECT_TRUE(parse(" \r\n\t\n").messages.empty());
}

TEST(DbcParser, ReadsWindowsLineEndsAndAByteOrderMark) {
  std::string text = "\xEF\xBB\xBF";
  for (const char c : kBench) text += c == '\n' ? std::string("\r\n") : std::string(1, c);
  const DbcDatabase dbc = parse(text);
  EXPECT_EQ(dbc.messages.size(), 2u);
  EXPECT_EQ(dbc.messages[0].position.line, 17);
}

TEST(DbcParser, TakesLatin1TextsAndGivesUtf8) {
  const DbcDatabase dbc =
      parse(with_signal("s : 0|8@1+ (1,0) [0|0] \"\xB0"
                        "C\" N",
                        "CM_ \"gr\xC3\xBC\xC3\x9F\";"));
  EXPECT_EQ(dbc.messages[0].signals[0].unit,
            "\xC2\xB0"
            "C");
  EXPECT_EQ(dbc.comment, "gr\xC3\xBC\xC3\x9F");
}

TEST(DbcParser, ReadsNumbersInEveryNotation) {
  const DbcDatabase dbc = parse(with_signal("s : 0|8@1+ (+1E-3,-.5) [-1.5e+2|1.] \"\" N"));
  const DbcSignal& signal = dbc.messages[0].signals[0];
  EXPECT_EQ(signal.factor, 1e-3);
  EXPECT_EQ(signal.offset, -0.5);
  EXPECT_EQ(signal.minimum, -150.0);
  EXPECT_EQ(signal.maximum, 1.0);
}

TEST(DbcParser, DoesWithoutTransmitterAndReceivers) {
  const DbcDatabase dbc = parse("BO_ 1 M: 8\n SG_ s : 0|8@1+ (1,0) [0|0] \"\"\nBO_ 2 L: 0\n");
  EXPECT_EQ(dbc.messages.size(), 2u);
  EXPECT_TRUE(dbc.messages[0].transmitter.empty());
  EXPECT_TRUE(dbc.messages[0].signals[0].receivers.empty());
}

TEST(DbcParser, KeepsQuietAboutThePseudoMessageOfIndependentSignals) {
  const DbcDatabase dbc = parse(
      "BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX\n"
      " SG_ s : 0|8@1+ (1,0) [0|0] \"\" N\n"
      "CM_ SG_ 3221225472 s \"nowhere\";");
  EXPECT_TRUE(dbc.messages.empty());
  EXPECT_TRUE(dbc.warnings.empty());
}

TEST(DbcParser, WarnsWhenAnIdentifierIsUsedTwice) {
  const DbcDatabase dbc = parse("BO_ 1 A: 8 N\nBO_ 1 B: 8 N\nCM_ BO_ 1 \"the first\";");
  EXPECT_EQ(dbc.messages.size(), 2u);
  EXPECT_EQ(dbc.messages[0].comment, "the first");
  ASSERT_EQ(dbc.warnings.size(), 1u);
  EXPECT_EQ(dbc.warnings[0].text, "message identifier 1 of B is used before, by A");
  EXPECT_EQ(dbc.warnings[0].position.line, 2);
}

TEST(DbcParser, WarnsWhenASignalNameIsUsedTwice) {
  const DbcDatabase dbc =
      parse(with_signal("s : 0|8@1+ (1,0) [0|0] \"\" N", " SG_ s : 8|8@1+ (1,0) [0|0] \"\" N"));
  EXPECT_EQ(dbc.messages[0].signals.size(), 2u);
  ASSERT_EQ(dbc.warnings.size(), 1u);
  EXPECT_EQ(dbc.warnings[0].text, "message M has two signals s");
}

TEST(DbcParser, WarnsWhenASignalEndsBeyondItsMessage) {
  const DbcDatabase dbc = parse(with_signal("s : 60|8@1+ (1,0) [0|0] \"\" N"));
  ASSERT_EQ(dbc.warnings.size(), 1u);
  EXPECT_EQ(dbc.warnings[0].text, "signal s needs 9 bytes, message M has 8");
  EXPECT_EQ(dbc.warnings[0].position.line, 2);
}

TEST(DbcParser, WarnsWhenAMessageIsLongerThanAFrame) {
  const DbcDatabase dbc = parse("BO_ 1 M: 65 N");
  ASSERT_EQ(dbc.warnings.size(), 1u);
  EXPECT_EQ(dbc.warnings[0].text, "message M has 65 bytes, more than a frame carries (64)");
}

TEST(DbcParser, WarnsOfStatementsAboutNothing) {
  const DbcDatabase dbc = parse("BO_ 1 M: 8 N\nCM_ BO_ 2 \"a\";\nVAL_ 1 s 0 \"a\" ;");
  ASSERT_EQ(dbc.warnings.size(), 2u);
  EXPECT_EQ(dbc.warnings[0].text, "there is no message with identifier 2");
  EXPECT_EQ(dbc.warnings[1].text, "message M has no signal s");
}

TEST(DbcParser, WarnsOfAnAttributeThatIsNotDefined) {
  const DbcDatabase dbc = parse("BA_ \"A\" 5;\nBA_ \"B\" \"five\";");
  EXPECT_EQ(dbc.attributes.at("A"), DbcAttributeValue(std::int64_t{5}));
  EXPECT_EQ(dbc.attributes.at("B"), DbcAttributeValue(std::string("five")));
  ASSERT_EQ(dbc.warnings.size(), 2u);
  EXPECT_EQ(dbc.warnings[0].text, "attribute A is not defined before it is used");
}

struct ErrorCase {
  std::string text;
  std::string error;
};

class DbcParserErrors : public testing::TestWithParam<ErrorCase> {};

TEST_P(DbcParserErrors, AreLocatedAndSayWhatWasFoundAndExpected) {
  EXPECT_EQ(error_of(GetParam().text), GetParam().error);
}

INSTANTIATE_TEST_SUITE_P(
    OfEveryKind, DbcParserErrors,
    testing::Values(
        ErrorCase{"hello", "bench.dbc:1:1: found \"hello\", expected a section such as BO_"},
        ErrorCase{"\n  42", "bench.dbc:2:3: found number 42, expected a section such as BO_"},
        ErrorCase{" SG_ s", "bench.dbc:1:2: found \"SG_\", expected a section such as BO_"},
        ErrorCase{"\x01", "bench.dbc:1:1: found byte 0x01, expected a section such as BO_"},
        ErrorCase{"VERSION 1", "bench.dbc:1:9: found number 1, expected the version, a string"},
        ErrorCase{"VERSION \"1",
                  "bench.dbc:1:9: found a string without end, expected a closing \""},
        ErrorCase{"BO_ 1", "bench.dbc:1:6: found the end of the file, expected the message's name"},
        ErrorCase{"BO_ -1 M: 8 N",
                  "bench.dbc:1:5: found number -1, expected a message identifier, "
                  "a whole number up to 4294967295"},
        ErrorCase{"BO_ 2048 M: 8 N",
                  "bench.dbc:1:5: found number 2048, expected an identifier up "
                  "to 2047, or up to 536870911 with bit 31 set"},
        ErrorCase{"BO_ 1 M; 8 N", "bench.dbc:1:8: found \";\", expected \":\""},
        ErrorCase{with_signal("s : 512|8@1+ (1,0) [0|0] \"\" N"),
                  "bench.dbc:2:10: found number 512, expected a start bit up to 511"},
        ErrorCase{with_signal("s : 0|0@1+ (1,0) [0|0] \"\" N"),
                  "bench.dbc:2:12: found number 0, expected 1 to 64 bits"},
        ErrorCase{with_signal("s : 0|65@1+ (1,0) [0|0] \"\" N"),
                  "bench.dbc:2:12: found number 65, expected 1 to 64 bits"},
        ErrorCase{with_signal("s : 508|8@1+ (1,0) [0|0] \"\" N"),
                  "bench.dbc:2:14: found number 8, expected a signal that ends within 64 bytes"},
        ErrorCase{with_signal("s : 0|8@2+ (1,0) [0|0] \"\" N"),
                  "bench.dbc:2:14: found number 2, expected the byte order, 1 (Intel) or 0 "
                  "(Motorola)"},
        ErrorCase{with_signal("s : 0|8@1 (1,0) [0|0] \"\" N"),
                  "bench.dbc:2:16: found \"(\", expected \"+\" (unsigned) or \"-\" (signed)"},
        ErrorCase{with_signal("s : 0|8@1+ (0,0) [0|0] \"\" N"),
                  "bench.dbc:2:18: found number 0, expected a factor other than zero"},
        ErrorCase{with_signal("s : 0|8@1+ (1e999,0) [0|0] \"\" N"),
                  "bench.dbc:2:18: found number 1e999, expected the factor, a number that a double "
                  "can hold"},
        ErrorCase{with_signal("s q : 0|8@1+ (1,0) [0|0] \"\" N"),
                  "bench.dbc:2:8: found \"q\", expected \"M\", \"m<number>\" or \":\""},
        ErrorCase{with_signal("s : 0|8@1+ (1,0) [0|0] N"),
                  "bench.dbc:2:29: found \"N\", expected the unit, a string"},
        ErrorCase{with_signal("s : 0|16@1+ (1,0) [0|0] \"\" N", "SIG_VALTYPE_ 1 s : 1;"),
                  "bench.dbc:3:14: found a float of 16 bits in signal s, expected 32"},
        ErrorCase{"VAL_TABLE_ a 1 \"b\"",
                  "bench.dbc:1:19: found the end of the file, expected \";\" after VAL_TABLE_ of "
                  "line 1"},
        ErrorCase{"BA_DEF_ \"A\" ENUM \"a\",\"b\";\nBA_ \"A\" 2;",
                  "bench.dbc:2:9: found number 2, expected an index below 2 or one of \"a\", "
                  "\"b\""}));

TEST(DbcParser, GivesThePositionOfAnErrorAsNumbers) {
  try {
    static_cast<void>(parse("\n\n BO_ x"));
    FAIL() << "no error";
  } catch (const DbcError& error) {
    EXPECT_EQ(error.position().line, 3);
    EXPECT_EQ(error.position().column, 6);
  }
}

TEST(DbcParser, ReadsAFileAndNamesItInErrors) {
  const auto file =
      std::filesystem::temp_directory_path() /
      ("faultline_dbc_parser_test_" + std::to_string(std::random_device{}()) + ".dbc");
  std::ofstream(file) << "BO_ x";
  try {
    static_cast<void>(read_dbc(file));
    ADD_FAILURE() << "no error";
  } catch (const DbcError& error) {
    EXPECT_EQ(std::string(error.what()).find(file.string() + ":1:5: found"), 0u) << error.what();
  }
  std::filesystem::remove(file);
  EXPECT_THROW(static_cast<void>(read_dbc(file)), std::system_error);
  EXPECT_THROW(static_cast<void>(read_dbc(std::filesystem::temp_directory_path())),
               std::system_error);
}

/// Changes `text` in one of the ways files go wrong.
void mutate(std::string& text, std::mt19937_64& engine) {
  constexpr std::string_view kFragments[] = {
      "\"",    ";",  ":",  "BO_ ",  "SG_ ", "BA_ ", "\n", "|",    "@", "-", "999999999999999999999",
      "1e400", "\\", "\0", "VAL_ ", "ENUM", "\xFF", ",",  "NS_ :"};
  const auto below = [&](std::size_t limit) {
    return std::uniform_int_distribution<std::size_t>(0, limit - 1)(engine);
  };
  const std::size_t at = below(text.size() + 1);
  switch (below(5)) {
    case 0:
      text.resize(at);
      break;
    case 1:
      text.erase(at, below(20));
      break;
    case 2:
      text.insert(at, kFragments[below(std::size(kFragments))]);
      break;
    case 3:
      if (at < text.size()) text[at] = static_cast<char>(below(256));
      break;
    default:
      text.insert(at, text.substr(below(text.size() + 1), below(200)));
      break;
  }
}

TEST(DbcParser, SurvivesAnyMutationOfAFile) {
  const std::uint64_t seed = test_seed(3);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  int parsed = 0;
  int refused = 0;
  for (int n = 0; n < 5000; ++n) {
    std::string text(kBench);
    for (std::size_t k = 0; k <= engine() % 4; ++k) mutate(text, engine);
    try {
      static_cast<void>(parse(text));
      ++parsed;
    } catch (const DbcError&) {
      ++refused;
    }
  }
  EXPECT_GT(parsed, 100);
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace faultline

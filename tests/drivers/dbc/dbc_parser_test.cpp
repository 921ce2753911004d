#include "drivers/dbc/dbc_parser.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <ostream>
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
CM_ EV_ Env "a knob";
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

/// "line:column: text" of the warnings of `severity`.
std::vector<std::string> warnings_of(const DbcDatabase& dbc, DbcSeverity severity) {
  std::vector<std::string> texts;
  for (const DbcWarning& warning : dbc.warnings) {
    if (warning.severity != severity) continue;
    texts.push_back(std::to_string(warning.position.line) + ":" +
                    std::to_string(warning.position.column) + ": " + warning.text);
  }
  return texts;
}

using Texts = std::vector<std::string>;

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
  EXPECT_EQ(y1->receivers, (DbcNames{"Controller", "Tester"}));
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

TEST(DbcParser, ReadsTablesTransmittersAndEnvironmentVariables) {
  const DbcDatabase dbc = parse(kBench);
  ASSERT_EQ(dbc.value_tables.size(), 1u);
  EXPECT_EQ(dbc.value_tables[0].name, "OnOff");
  ASSERT_EQ(dbc.value_tables[0].values.size(), 2u);
  EXPECT_EQ(dbc.value_tables[0].values[0].name, "on");
  EXPECT_EQ(dbc.messages[0].other_transmitters, (DbcNames{"Plant", "Controller"}));
  ASSERT_EQ(dbc.environment_variables.size(), 1u);
  const DbcEnvironmentVariable& variable = dbc.environment_variables[0];
  EXPECT_EQ(variable.name, "Env");
  EXPECT_EQ(variable.maximum, 1.0);
  EXPECT_EQ(variable.nodes, (DbcNames{"Vector__XXX"}));
  EXPECT_EQ(variable.comment, "a knob");
  ASSERT_EQ(variable.value_names.size(), 1u);
  EXPECT_EQ(variable.value_names[0].name, "a");
}

TEST(DbcParser, SaysOnlyWhatIsOddAboutAUsualFile) {
  const DbcDatabase dbc = parse(kBench);
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kError), Texts{});
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kNote), Texts{});
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kWarning),
            (Texts{"24:6: message Inputs has several multiplexers, and no SG_MUL_VAL_ says which "
                   "selects u1; taken is mux"}));
}

TEST(DbcParser, NotesOnceWhichKnownSectionsItDoesNotKeepAndWarnsOfUnknownOnes) {
  const DbcDatabase dbc = parse(
      "BO_ 1 M: 8 N\nBA_DEF_REL_ BU_SG_REL_ \"a;b\" INT 0 1;\nBA_REL_ \"a\" BU_SG_REL_ N SG_ 1 s "
      "1;\nBA_REL_ \"a\" BU_SG_REL_ N SG_ 1 t 1;\nMADE_UP_ 1 2 3;\nMADE_UP_ 4;");
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kError), Texts{});
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kNote),
            (Texts{"2:1: section BA_DEF_REL_ is not read", "3:1: section BA_REL_ is not read"}));
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kWarning),
            (Texts{"5:1: section MADE_UP_ is not known, and not read",
                   "6:1: section MADE_UP_ is not known, and not read"}));
}

TEST(DbcParser, RefusesWhatIsNoDbcAtAll) {
  EXPECT_EQ(error_of(""),
            "bench.dbc:1:1: found the end of the file, expected a section such as BO_");
  EXPECT_EQ(error_of(" \r\n\t\n"),
            "bench.dbc:3:1: found the end of the file, expected a section such as BO_");
  EXPECT_EQ(error_of("hello world; this is\na letter"),
            "bench.dbc:1:1: found \"hello\", expected a section such as BO_; what follows is "
            "skipped");
  EXPECT_EQ(error_of(std::string("BO_ 1\nM\0: 8", 11)),
            "bench.dbc:2:2: found byte 0x00, expected text; this is no DBC file");
  EXPECT_EQ(error_of("\xFF\xFE"
                     "B"),
            "bench.dbc:1:1: found the mark of UTF-16 text, expected UTF-8 or Latin-1");
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
/// Its place, for the test's name.
void PrintTo(const ErrorCase& error_case, std::ostream* out) {
  *out << error_case.error.substr(0, error_case.error.find(' '));
}

/// A statement that is understood, so that the text is a DBC at all.
constexpr std::string_view kUnderstood = "\nBU_: Understood\n";

class DbcParserErrors : public testing::TestWithParam<ErrorCase> {};

TEST_P(DbcParserErrors, AreLocatedAndSayWhatWasFoundAndExpectedAndWhatIsLost) {
  const DbcDatabase dbc = parse(GetParam().text + std::string(kUnderstood));
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kError), Texts{GetParam().error});
  EXPECT_EQ(dbc.nodes, Texts{"Understood"});
}

INSTANTIATE_TEST_SUITE_P(
    OfEveryKind, DbcParserErrors,
    testing::Values(
        ErrorCase{"hello",
                  "1:1: found \"hello\", expected a section such as BO_; what follows is "
                  "skipped"},
        ErrorCase{"\n  42",
                  "2:3: found number 42, expected a section such as BO_; what follows is "
                  "skipped"},
        ErrorCase{" SG_ s",
                  "1:2: found \"SG_\", expected a message (BO_) before its signals; the "
                  "signal is skipped"},
        ErrorCase{"\x01",
                  "1:1: found byte 0x01, expected a section such as BO_; what follows is "
                  "skipped"},
        ErrorCase{"VERSION 1",
                  "1:9: found number 1, expected the version, a string; the statement is skipped"},
        ErrorCase{"VERSION \"1",
                  "1:9: found a string without end, expected a closing \"; it ends with its line"},
        ErrorCase{"BO_ 1",
                  "2:1: found \"BU_\", expected the message's name; the message and its "
                  "signals are skipped"},
        ErrorCase{"BO_ -1 M: 8 N\n SG_ s",
                  "1:5: found number -1, expected a message identifier, a whole number up to "
                  "4294967295; the message and its signals are skipped"},
        ErrorCase{
            "BO_ 4294967296 M: 8 N",
            "1:5: found number 4294967296, expected a message identifier, a whole number up to "
            "4294967295; the message and its signals are skipped"},
        ErrorCase{"BO_ 1 M 8 N",
                  "1:9: found number 8, expected \":\"; the message and its signals "
                  "are skipped"},
        ErrorCase{with_signal("s : 65536|8@1+ (1,0) [0|0] \"\" N"),
                  "2:10: found number 65536, expected the start bit, a whole number up to 65535; "
                  "the signal is skipped"},
        ErrorCase{with_signal("s : 0|8@2+ (1,0) [0|0] \"\" N"),
                  "2:14: found number 2, expected the byte order, 1 (Intel) or 0 (Motorola); the "
                  "signal is skipped"},
        ErrorCase{with_signal("s : 0|8@1 (1,0) [0|0] \"\" N"),
                  "2:16: found \"(\", expected \"+\" (unsigned) or \"-\" (signed); the signal is "
                  "skipped"},
        ErrorCase{with_signal("s : 0|8@1+ (1,5,0) [0|0] \"\" N"),
                  "2:21: found \",\", expected \")\"; the signal is skipped"},
        ErrorCase{with_signal("s q : 0|8@1+ (1,0) [0|0] \"\" N"),
                  "2:8: found \"q\", expected \"M\", \"m<number>\" or \":\"; the signal is "
                  "skipped"},
        ErrorCase{with_signal("s : 0|8@1+ (1,0) [0|0] N"),
                  "2:29: found \"N\", expected the unit, a string; the signal is skipped"},
        ErrorCase{with_signal("s : 0|8@1+ (1,0) [0|0] \"N"),
                  "2:29: found a string without end, expected a closing \"; it ends with its line"},
        ErrorCase{with_signal("s : 0|8@1+ (1,0) [0|0] \"\" N", "SIG_VALTYPE_ 1 s : 3;"),
                  "3:20: found number 3, expected 0 (integer), 1 (float) or 2 (double); the "
                  "statement is skipped"},
        ErrorCase{"VAL_TABLE_ a 1 \"b\" x",
                  "1:20: found \"x\", expected a value, a whole number, or \";\"; the statement is "
                  "skipped"},
        ErrorCase{
            "BA_DEF_ \"A\" INTEGER;",
            "1:13: found \"INTEGER\", expected INT, HEX, FLOAT, STRING or ENUM; the statement "
            "is skipped"},
        ErrorCase{"BA_ \"A\" x;",
                  "1:9: found \"x\", expected the attribute's value, a string or a "
                  "number; the statement is skipped"}));

struct WarningCase {
  std::string text;
  std::string warning;
};
/// Its place, for the test's name.
void PrintTo(const WarningCase& warning_case, std::ostream* out) {
  *out << warning_case.warning.substr(0, warning_case.warning.find(' '));
}

class DbcParserWarnings : public testing::TestWithParam<WarningCase> {};

TEST_P(DbcParserWarnings, AreLocatedAndNothingIsLost) {
  const DbcDatabase dbc = parse(GetParam().text + std::string(kUnderstood));
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kError), Texts{});
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kWarning), Texts{GetParam().warning});
}

INSTANTIATE_TEST_SUITE_P(
    OfEveryKind, DbcParserWarnings,
    testing::Values(
        WarningCase{"BO_ 2048 M: 8 N",
                    "1:5: message M has the identifier 2048, expected up to 2047, or up to "
                    "536870911 with bit 31 set; it is taken for the extended identifier 2048"},
        WarningCase{"BO_ 1075054137 M: 8 N",
                    "1:5: message M has the identifier 1075054137, expected up to 2047, or up to "
                    "536870911 with bit 31 set; it is taken for the extended identifier 1312313"},
        WarningCase{with_signal("s : 0|8@1+ (1,0) [0|0] \"\" N\";"),
                    "2:33: found string \";\" behind the end of a statement; what follows is "
                    "skipped"},
        WarningCase{"BO_ 1 M: 8 N\nBO_ 2 M: 8 N", "2:5: there are two messages M"},
        WarningCase{with_signal("1st-Gear : 0|8@1+ (1,0) [0|0] \"\" N"),
                    "2:6: the name \"1st-Gear\" is no C identifier, and so not what the format "
                    "allows"},
        WarningCase{with_signal("s : 512|8@1+ (1,0) [0|0] \"\" N"),
                    "2:6: signal s needs 65 bytes, message M has 8"},
        WarningCase{with_signal("s : 0|0@1+ (1,0) [0|0] \"\" N"),
                    "2:6: signal s has 0 bits, expected 1 to 64"},
        WarningCase{"BO_ 1 M: 16\n SG_ s : 0|65@1+ (1,0) [0|0] \"\" N",
                    "2:6: signal s has 65 bits, expected 1 to 64"},
        WarningCase{with_signal("s : 0|8@1+ (0,0) [0|0] \"\" N"),
                    "2:18: signal s has the factor zero, and so no value"},
        WarningCase{with_signal("s : 0|8@1+ (1e999,0) [0|0] \"\" N"),
                    "2:18: found number 1e999, expected the factor that a double can hold"},
        WarningCase{with_signal("s : 0|8@1+ (1,0) [-1.#IND|0] \"\" N"),
                    "2:24: found number -1.#IND, expected the minimum that a double can hold"},
        WarningCase{with_signal("s : 0|16@1+ (1,0) [0|0] \"\" N", "SIG_VALTYPE_ 1 s : 1;"),
                    "3:14: signal s is a float of 16 bits, expected 32; it has no value"},
        WarningCase{
            with_signal("s m1 : 0|8@1+ (1,0) [0|0] \"\" N"),
            "2:6: signal s is multiplexed, but message M has no multiplexer; it is taken as "
            "always present"},
        WarningCase{
            "BA_DEF_ \"A\" ENUM \"a\",\"b\";\nBA_ \"A\" 2;",
            "2:9: found 2 for attribute A, expected an index below 2 or one of \"a\", \"b\""},
        WarningCase{"BA_DEF_ \"A\" INT 0 1;\nBA_ \"A\" \"x\";",
                    "2:9: attribute A is a number, but has a text"},
        WarningCase{"BA_DEF_ \"A\" STRING;\nBA_ \"A\" 2;",
                    "2:9: attribute A is a text, but has a number"},
        WarningCase{"BA_DEF_ \"A\" INT 0 1;\nBA_ \"A\" 2.5;",
                    "2:9: found 2.5 for attribute A, expected a whole number"},
        WarningCase{"BA_DEF_ \"A\" INT 0 1;\nBA_ \"A\" 2;\nBA_ \"A\" 3;",
                    "1:1: 1 attributes of the network are given twice; the last counts"},
        WarningCase{"BA_DEF_ \"A\" INT 0 1;\nBA_ \"A\" BU_ Nobody 2;",
                    "2:13: there is no node Nobody"},
        WarningCase{"CM_ \"a\"", "2:1: found \"BU_\", expected \";\" before it"},
        WarningCase{"VAL_ Nothing 0 \"a\";", "1:6: there is no environment variable Nothing"},
        WarningCase{with_signal("s : 0|8@1+ (1,0) [0|0] \"\" N", "VAL_ 1 s Table ;"),
                    "3:10: there is no value table Table"},
        WarningCase{with_signal("s : 0|8@1+ (1,0) [0|0] \"\" N", "VAL_ 1 s 0 \"a\" 0 \"b\" ;"),
                    "2:6: s has several names for the value 0; the first counts"}));

TEST(DbcParser, LosesOneSignalAndNotItsMessageToABadLine) {
  const DbcDatabase dbc = parse(
      "BO_ 1 M: 8 N\n SG_ a : 0|8@1+ (1,0) [0|0] \"\" N\n SG_ b : 8|x SG_ c : 16|8@1+ (1,0) [0|0] "
      "\"\" N\n SG_ d : 24|8@1+ (1,0) [0|0 \"\" N\n SG_ e : 32|8@1+ (1,0) [0|0] \"\" N\nBO_ 2 L: 8 "
      "N");
  ASSERT_EQ(dbc.messages.size(), 2u);
  ASSERT_EQ(dbc.messages[0].signals.size(), 3u);
  EXPECT_EQ(dbc.messages[0].signals[1].name, "c");
  EXPECT_EQ(dbc.messages[0].signals[2].name, "e");
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kError).size(), 2u);
}

TEST(DbcParser, SaysOnceThatAMessageIsLostWithItsSignals) {
  const DbcDatabase dbc = parse(
      "BO_ x M: 8 N\n SG_ a : 0|8@1+ (1,0) [0|0] \"\" N\n SG_ b : what\n"
      "BO_ 2 L: 8 N\n SG_ a : 0|8@1+ (1,0) [0|0] \"\" N\n");
  ASSERT_EQ(dbc.messages.size(), 1u);
  EXPECT_EQ(dbc.messages[0].signals.size(), 1u);
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kError).size(), 1u);
}

TEST(DbcParser, ReadsIntegersInEveryNotation) {
  const DbcDatabase dbc = parse(
      "BO_ 1e+02 M: 8.0 N\n SG_ s : +8|8.0@1+ (1,0) [0|0] \"\" N\n"
      "VAL_ 100 s 1e+09 \"e\" -1.0 \"minus\" 0x10 \"hex\" 18446744073709551614 \"all but one\" ;");
  ASSERT_EQ(dbc.warnings.size(), 0u);
  EXPECT_EQ(dbc.messages[0].id, 100u);
  EXPECT_EQ(dbc.messages[0].length, 8);
  const auto& names = dbc.messages[0].signals[0].value_names;
  EXPECT_EQ(dbc.messages[0].signals[0].start_bit, 8);
  ASSERT_EQ(names.size(), 4u);
  EXPECT_EQ(names[0].value, -2);
  EXPECT_EQ(names[1].value, -1);
  EXPECT_EQ(names[2].value, 16);
  EXPECT_EQ(names[3].value, 1'000'000'000);
}

TEST(DbcParser, ReadsStatementsThatAreWrappedAnywhere) {
  std::string text(kBench);
  for (const char* const at : {" (0.01", "-5)", "|100]", "\"V\"", ",Tester", "SG_ 256 k 2",
                               " 15 \"f", ": 1;", "\"V\" Controller"}) {
    const std::size_t found = text.find(at);
    ASSERT_NE(found, std::string::npos);
    text.insert(found, "\n   ");
  }
  const DbcDatabase usual = parse(kBench);
  const DbcDatabase wrapped = parse(text);
  EXPECT_EQ(wrapped.warnings.size(), usual.warnings.size());
  const DbcSignal& y1 = wrapped.messages[0].signals[0];
  EXPECT_EQ(y1.factor, 0.01);
  EXPECT_EQ(y1.offset, -5.0);
  EXPECT_EQ(y1.receivers, (DbcNames{"Controller", "Tester"}));
  EXPECT_EQ(wrapped.messages[0].signals[2].attributes, usual.messages[0].signals[2].attributes);
  EXPECT_EQ(wrapped.messages[0].signals[2].value_names.size(), 2u);
  EXPECT_EQ(wrapped.messages[1].signals[1].type, SignalType::kFloat32);
}

TEST(DbcParser, DoesWithoutHeaderSectionsAndSemicolons) {
  const DbcDatabase dbc = parse(with_signal("s : 0|8@1+ (1,0) [0|0] \"\" N",
                                            "CM_ SG_ 1 s \"a comment\"\n"
                                            "BA_DEF_ SG_ \"A\" INT 0 1\n"
                                            "BA_ \"A\" SG_ 1 s 1\n"
                                            "VAL_ 1 s 0 \"off\" 1 \"on\"\n"
                                            "SIG_VALTYPE_ 1 s : 0"));
  const DbcSignal& signal = dbc.messages[0].signals[0];
  EXPECT_EQ(signal.comment, "a comment");
  EXPECT_EQ(signal.attributes.at("A"), DbcAttributeValue(std::int64_t{1}));
  EXPECT_EQ(signal.value_names.size(), 2u);
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kWarning).size(), 5u);
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kError), Texts{});
}

TEST(DbcParser, FindsLinesThatEndWithCarriageReturnsOnly) {
  std::string text(kBench);
  std::replace(text.begin(), text.end(), '\n', '\r');
  const DbcDatabase dbc = parse(text);
  EXPECT_EQ(dbc.messages.size(), 2u);
  EXPECT_EQ(dbc.messages[1].signals.size(), 3u);
  EXPECT_EQ(dbc.messages[0].position.line, 17);
  EXPECT_EQ(dbc.messages[0].position.column, 5);
}

TEST(DbcParser, TakesOddNamesWhereverNamesStand) {
  const DbcDatabase dbc = parse(
      "BU_: 1st_ECU A-B\nBO_ 1 2-Way/Valve: 8 1st_ECU\n SG_ 1st_Gear : 0|8@1+ (1,0) [0|0] \"\" "
      "A-B\n"
      " SG_ $b.c m0 : 8|8@1+ (1,0) [0|0] \"\" A-B,1st_ECU\n SG_ 3 M : 16|8@1+ (1,0) [0|0] \"\"\n"
      " SG_ gr\xC3\xB6\xC3\x9F"
      "e : 24|8@1+ (1,0) [0|0] \"\"\n"
      "CM_ SG_ 1 1st_Gear \"a\";\nVAL_ 1 $b.c 0 \"b\";\nCM_ SG_ 1 gr\xC3\xB6\xC3\x9F"
      "e \"size\";\n"
      "CM_ BU_ A-B \"node\";\nVAL_ 1 3 0 \"three\";");
  EXPECT_EQ(warnings_of(dbc, DbcSeverity::kError), Texts{});
  EXPECT_EQ(dbc.nodes, (Texts{"1st_ECU", "A-B"}));
  const DbcMessage& message = dbc.messages.at(0);
  EXPECT_EQ(message.name, "2-Way/Valve");
  EXPECT_EQ(message.transmitter, "1st_ECU");
  ASSERT_EQ(message.signals.size(), 4u);
  EXPECT_EQ(message.signals[0].comment, "a");
  EXPECT_EQ(message.signals[1].name, "$b.c");
  EXPECT_EQ(message.signals[1].value_names.size(), 1u);
  EXPECT_EQ(message.signals[1].multiplexer, 2);
  EXPECT_EQ(message.signals[1].receivers, (DbcNames{"A-B", "1st_ECU"}));
  EXPECT_EQ(message.signals[2].value_names.size(), 1u);
  EXPECT_EQ(message.signals[3].comment, "size");
  EXPECT_EQ(dbc.node_comments.at("A-B"), "node");
}

TEST(DbcParser, KeepsQuotesInsideComments) {
  const auto comment = [](std::string_view text) {
    return parse("CM_ " + std::string(text) + "\nBU_: A").comment;
  };
  EXPECT_EQ(comment(R"("a \"b\" c";)"), "a \"b\" c");
  EXPECT_EQ(comment(R"("a ""b"" c";)"), "a \"b\" c");
  EXPECT_EQ(comment(R"("a "b" c";)"), "a \"b\" c");
  EXPECT_EQ(comment("\"a; \"b\"\n\n; c\" ;"), "a; \"b");
  EXPECT_EQ(comment("\"one\nBO_ 1 in a comment\ntwo\";"), "one\nBO_ 1 in a comment\ntwo");
  EXPECT_EQ(comment("\"\";"), "");
  EXPECT_EQ(comment(R"("C:\\dir";)"), "C:\\dir");
}

TEST(DbcParser, EndsAStringWithoutEndBeforeTheNextStatement) {
  const DbcDatabase dbc = parse(
      "BO_ 1 M: 8 N\n SG_ a : 0|8@1+ (1,0) [0|0] \"km/h N\n SG_ b : 8|8@1+ (1,0) [0|0] \"V\" N\n"
      "CM_ BO_ 1 \"no end\nin two lines;\nCM_ SG_ 1 a \"C:\\path\\\";\nCM_ SG_ 1 b \"fine\";\n"
      "VAL_ 1 a 0 \"off 1 \"on\" ;\nVAL_ 1 b 0 \"off\" ;\nCM_ \"the end");
  ASSERT_EQ(dbc.messages.at(0).signals.size(), 2u);
  EXPECT_EQ(dbc.messages[0].comment, "no end\nin two lines");
  EXPECT_EQ(dbc.messages[0].signals[0].comment, "C:\\path\\");
  EXPECT_EQ(dbc.messages[0].signals[1].unit, "V");
  EXPECT_EQ(dbc.messages[0].signals[1].comment, "fine");
  EXPECT_EQ(dbc.messages[0].signals[1].value_names.size(), 1u);
  EXPECT_EQ(dbc.comment, "the end");
  const Texts errors = warnings_of(dbc, DbcSeverity::kError);
  ASSERT_EQ(errors.size(), 5u);
  EXPECT_EQ(errors[1],
            "4:11: found a string without end, expected a closing \"; it ends with its "
            "statement");
}

TEST(DbcParser, SkipsLineComments) {
  const DbcDatabase dbc = parse(
      "// made by hand\nBU_: A // the first\nBO_ 1 M: 8 A//x\n"
      " SG_ s : 0|8@1+ (1,0) [0|0] \"//\" A");
  EXPECT_TRUE(dbc.warnings.empty());
  EXPECT_EQ(dbc.messages.at(0).transmitter, "A");
  EXPECT_EQ(dbc.messages[0].signals.at(0).unit, "//");
}

TEST(DbcParser, TakesWindows1252ForWhatIsNoUtf8) {
  EXPECT_EQ(parse("CM_ \"\x80 \x96 \xFC\";").comment, "\xE2\x82\xAC \xE2\x80\x93 \xC3\xBC");
}

TEST(DbcParser, ResolvesValueTablesByName) {
  const DbcDatabase dbc = parse("VAL_TABLE_ OnOff 1 \"on\" 0 \"off\" ;\n" +
                                with_signal("s : 0|8@1+ (1,0) [0|0] \"\" N", "VAL_ 1 s OnOff ;"));
  const auto& names = dbc.messages[0].signals[0].value_names;
  ASSERT_EQ(names.size(), 2u);
  EXPECT_EQ(names[0].name, "off");
  EXPECT_TRUE(dbc.warnings.empty());
}

TEST(DbcParser, ReadsSignalGroups) {
  const DbcDatabase dbc = parse(with_signal(
      "s : 0|8@1+ (1,0) [0|0] \"\" N", "SIG_GROUP_ 1 Group 2 : s t;\nSIG_GROUP_ 5 Lost 1 : s;"));
  ASSERT_EQ(dbc.signal_groups.size(), 1u);
  EXPECT_EQ(dbc.signal_groups[0].name, "Group");
  EXPECT_EQ(dbc.signal_groups[0].message, 0u);
  EXPECT_EQ(dbc.signal_groups[0].repetitions, 2u);
  EXPECT_EQ(dbc.signal_groups[0].signals, (DbcNames{"s", "t"}));
  EXPECT_EQ(dbc.warnings.size(), 2u);
}

TEST(DbcParser, ListsNoMoreWarningsThanItSaysAndCountsTheRest) {
  std::string text = "BO_ 1 M: 8 N\n";
  for (std::size_t n = 0; n < DbcDatabase::kMaxWarnings + 50; ++n) text += "CM_ BO_ 2 \"\";\n";
  text += "what is this\n";
  const DbcDatabase dbc = parse(text);
  EXPECT_EQ(dbc.warnings.size(), DbcDatabase::kMaxWarnings + 1);
  EXPECT_EQ(dbc.further_warning_count, 50u);
  EXPECT_EQ(dbc.warnings.back().severity, DbcSeverity::kError);
}

/// A short text that asks for endless copies.
TEST(DbcParser, DoesNotLetAShortTextCopyWithoutEnd) {
  std::string text = "BO_ 1 M: 8 N\n SG_ s : 0|8@1+ (1,0) [0|0] \"\" N\nVAL_TABLE_ T 0 \"" +
                     std::string(200'000, 'x') + "\" ;\nBA_DEF_ \"A\" ENUM \"" +
                     std::string(200'000, 'y') + "\";\n";
  for (int n = 0; n < 20'000; ++n) text += "VAL_ 1 s T;\nBA_ \"A\" 0;\n";
  const DbcDatabase dbc = parse(text);
  std::size_t bytes = 0;
  for (const DbcValueName& name : dbc.messages[0].signals[0].value_names) bytes += name.name.size();
  EXPECT_LT(bytes, 6 * text.size());
  EXPECT_GT(dbc.further_warning_count, 10'000u);
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
    EXPECT_EQ(error.position().line, 1);
    EXPECT_EQ(error.position().column, 5);
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
  int understood = 0;
  int doubted = 0;
  int refused = 0;
  for (int n = 0; n < 5000; ++n) {
    std::string text(kBench);
    for (std::size_t k = 0; k <= engine() % 4; ++k) mutate(text, engine);
    try {
      const DbcDatabase dbc = parse(text);
      const int lines = 1 + static_cast<int>(std::count_if(text.begin(), text.end(), [](char c) {
                          return c == '\n' || c == '\r';
                        }));
      for (const DbcWarning& warning : dbc.warnings) {
        ASSERT_GE(warning.position.line, 1);
        ASSERT_LE(warning.position.line, lines);
        ASSERT_GE(warning.position.column, 1);
      }
      ++(warnings_of(dbc, DbcSeverity::kError).empty() ? understood : doubted);
    } catch (const DbcError&) {
      ++refused;
    }
  }
  EXPECT_GT(understood, 100);
  EXPECT_GT(doubted, 100);
  EXPECT_GT(refused, 10);
}

}  // namespace
}  // namespace faultline

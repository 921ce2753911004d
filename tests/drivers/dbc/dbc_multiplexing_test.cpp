#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "drivers/dbc/dbc_parser.h"

namespace faultline {
namespace {

/// A message of signals "name mark : start|bits" with `rest` behind it.
DbcDatabase parse_message(const std::vector<std::string>& signals, const std::string& rest = "") {
  std::string text = "BO_ 1 M: 8 N\n";
  for (const std::string& signal : signals) {
    text += " SG_ " + signal + "@1+ (1,0) [0|0] \"\" N\n";
  }
  return parse_dbc(text + rest, "m.dbc");
}

using Texts = std::vector<std::string>;

Texts warnings_of(const DbcDatabase& dbc) {
  Texts texts;
  for (const DbcWarning& warning : dbc.warnings) {
    texts.push_back(std::to_string(warning.position.line) + ": " + warning.text);
  }
  return texts;
}

std::string ranges_of(const DbcSignal& signal) {
  std::string text = std::to_string(signal.multiplexer);
  for (const DbcMultiplexRange& range : signal.multiplexer_ranges) {
    text += " " + std::to_string(range.first) + "-" + std::to_string(range.last);
  }
  return text;
}

TEST(DbcMultiplexing, LinksSimpleMultiplexingToTheOnlyMultiplexer) {
  const DbcDatabase dbc = parse_message({"a m0 : 8|8", "b m7 : 8|8", "mux M : 0|8", "c : 16|8"});
  EXPECT_EQ(warnings_of(dbc), Texts{});
  EXPECT_EQ(ranges_of(dbc.messages[0].signals[0]), "2 0-0");
  EXPECT_EQ(ranges_of(dbc.messages[0].signals[1]), "2 7-7");
  EXPECT_EQ(ranges_of(dbc.messages[0].signals[2]), "-1");
  EXPECT_EQ(ranges_of(dbc.messages[0].signals[3]), "-1");
}

TEST(DbcMultiplexing, LinksExtendedMultiplexingWithSeveralRangesOverSeveralLines) {
  const DbcDatabase dbc =
      parse_message({"mux M : 0|8", "sub m0M : 8|8", "a m3 : 16|8", "b m1 : 24|8"},
                    "SG_MUL_VAL_ 1 sub mux 0-0;\n"
                    "SG_MUL_VAL_ 1 a sub 9-12,\n   3-5, 6-6,\n 20-18;\n"
                    "SG_MUL_VAL_ 1 b mux 1-1, 18446744073709551615-18446744073709551615;\n");
  EXPECT_EQ(warnings_of(dbc), (Texts{"9: found the range 20-18, expected the lesser value first"}));
  const auto& signals = dbc.messages[0].signals;
  EXPECT_EQ(ranges_of(signals[1]), "0 0-0");
  EXPECT_EQ(ranges_of(signals[2]), "1 3-6 9-12 18-20");
  EXPECT_EQ(ranges_of(signals[3]), "0 1-1 18446744073709551615-18446744073709551615");
  EXPECT_TRUE(signals[1].is_multiplexer);
}

TEST(DbcMultiplexing, KeepsSafeFromCircles) {
  const DbcDatabase dbc =
      parse_message({"a m0M : 0|8", "b m1M : 8|8", "c m2M : 16|8", "d m0 : 24|8"},
                    "SG_MUL_VAL_ 1 a c 0-0;\nSG_MUL_VAL_ 1 b a 0-0;\nSG_MUL_VAL_ 1 c b 0-0;\n"
                    "SG_MUL_VAL_ 1 d b 1-2;\nSG_MUL_VAL_ 1 d d 1-2;\n");
  EXPECT_EQ(warnings_of(dbc),
            (Texts{"2: multiplexer a is selected, through others, by itself; it is taken as always "
                   "present",
                   "10: found \"d\", expected another signal of message M"}));
  const auto& signals = dbc.messages[0].signals;
  EXPECT_EQ(ranges_of(signals[0]), "-1");
  EXPECT_EQ(ranges_of(signals[1]), "0 0-0");
  EXPECT_EQ(ranges_of(signals[2]), "1 0-0");
  EXPECT_EQ(ranges_of(signals[3]), "1 1-2");
}

TEST(DbcMultiplexing, CutsChainsThatAreTooLong) {
  Texts signals{"s0 M : 0|1"};
  std::string rest;
  for (int n = 1; n < 20; ++n) {
    signals.push_back("s" + std::to_string(n) + " m0M : " + std::to_string(n) + "|1");
    rest += "SG_MUL_VAL_ 1 s" + std::to_string(n) + " s" + std::to_string(n - 1) + " 0-0;\n";
  }
  const DbcDatabase dbc = parse_message(signals, rest);
  EXPECT_EQ(dbc.warnings.size(), 2u);  // s9 and s18
  EXPECT_EQ(ranges_of(dbc.messages[0].signals[9]), "-1");
  EXPECT_EQ(ranges_of(dbc.messages[0].signals[8]), "7 0-0");
}

TEST(DbcMultiplexing, WarnsOfTwoMultiplexersAndTakesTheFirst) {
  const DbcDatabase dbc = parse_message({"x M : 0|8", "y M : 8|8", "a m0 : 16|8", "b m1 : 16|8"});
  EXPECT_EQ(
      warnings_of(dbc),
      (Texts{"4: message M has several multiplexers, and no SG_MUL_VAL_ says which selects a; "
             "taken is x"}));
  EXPECT_EQ(ranges_of(dbc.messages[0].signals[3]), "0 1-1");
}

TEST(DbcMultiplexing, WarnsOfASecondMultiplexerForOneSignal) {
  const DbcDatabase dbc = parse_message({"x M : 0|8", "y M : 8|8", "a m0 : 16|8"},
                                        "SG_MUL_VAL_ 1 a x 0-0;\nSG_MUL_VAL_ 1 a y 0-0;\n"
                                        "SG_MUL_VAL_ 1 a x 4-4;\nSG_MUL_VAL_ 1 a nobody 4-4;");
  EXPECT_EQ(warnings_of(dbc),
            (Texts{"6: signal a has a multiplexer already; this one does not count",
                   "8: found \"nobody\", expected another signal of message M"}));
  EXPECT_EQ(ranges_of(dbc.messages[0].signals[2]), "0 0-0 4-4");
}

TEST(DbcMultiplexing, KeepsTheMarkOfASignalWhoseRangesAreNotUnderstood) {
  const DbcDatabase dbc =
      parse_message({"x M : 0|8", "a m3 : 16|8"}, "SG_MUL_VAL_ 1 a x nothing;\n");
  ASSERT_EQ(dbc.warnings.size(), 1u);
  EXPECT_EQ(dbc.warnings[0].severity, DbcSeverity::kError);
  EXPECT_EQ(ranges_of(dbc.messages[0].signals[1]), "0 3-3");
}

TEST(DbcOverlapCheck, WarnsOfSignalsThatShareBits) {
  const DbcDatabase dbc = parse_message({"a : 0|8", "b : 7|4", "c : 11|4", "d : 0|16"});
  EXPECT_EQ(warnings_of(dbc), (Texts{"3: signal b overlaps signal a of message M",
                                     "5: signal d overlaps signal a of message M"}));
}

TEST(DbcOverlapCheck, KnowsTheBitsOfMotorolaSignals) {
  const auto overlaps = [](const char* motorola, const char* intel) {
    return !parse_dbc("BO_ 1 M: 8 N\n SG_ a : " + std::string(motorola) +
                          "@0+ (1,0) [0|0] \"\" N\n SG_ b : " + intel + "@1+ (1,0) [0|0] \"\" N\n",
                      "m.dbc")
                .warnings.empty();
  };
  EXPECT_TRUE(overlaps("3|8", "12|4"));
  EXPECT_FALSE(overlaps("3|8", "8|4"));
  EXPECT_FALSE(overlaps("3|8", "4|4"));
  EXPECT_TRUE(overlaps("7|16", "15|1"));
}

TEST(DbcOverlapCheck, LetsSignalsShareBitsThatAreNeverTogether) {
  const DbcDatabase dbc = parse_message(
      {"mux M : 0|4", "a m0 : 8|16", "b m1 : 8|16", "c m2 : 8|16", "sub m3M : 4|4", "d m0 : 8|8",
       "e m1 : 8|8"},
      "SG_MUL_VAL_ 1 d sub 0-0;\nSG_MUL_VAL_ 1 e sub 1-1;\nSG_MUL_VAL_ 1 a mux 0-0;\n"
      "SG_MUL_VAL_ 1 b mux 1-1;\nSG_MUL_VAL_ 1 c mux 2-2;\nSG_MUL_VAL_ 1 sub mux 3-3;\n");
  EXPECT_EQ(warnings_of(dbc), Texts{});
}

TEST(DbcOverlapCheck, WarnsOfMultiplexedSignalsThatCanBeTogether) {
  const DbcDatabase dbc =
      parse_message({"mux M : 0|4", "a m0 : 8|16", "b m1 : 8|16", "other M : 4|4", "c m0 : 16|4",
                     "always : 40|8", "d m5 : 44|8", "e m6 : 2|4"},
                    "SG_MUL_VAL_ 1 a mux 0-4;\nSG_MUL_VAL_ 1 b mux 3-3;\n"
                    "SG_MUL_VAL_ 1 c other 0-0;\nSG_MUL_VAL_ 1 d mux 5-5;\n"
                    "SG_MUL_VAL_ 1 e mux 6-6;\n");
  EXPECT_EQ(warnings_of(dbc), (Texts{"4: signal b overlaps signal a of message M",
                                     "6: signal c overlaps signal a of message M",
                                     "8: signal d overlaps signal always of message M",
                                     "9: signal e overlaps signal other of message M"}));
}

}  // namespace
}  // namespace faultline

#include "diagnosis/bank/bank_file.h"

#include <bit>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <system_error>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string refusal(const std::string& text) {
  try {
    static_cast<void>(parse_bank(text, "b.json"));
  } catch (const BankFileError& error) {
    return error.what();
  }
  return "";
}

/// The text of Hou's bank with the first `from` replaced.
std::string with(const std::string& from, const std::string& to) {
  std::string text = bank_text(hou_bank());
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

/// "line:column" of the first `what` in the text of Hou's bank.
std::string place_of(const std::string& what) {
  const std::string text = bank_text(hou_bank());
  const std::size_t at = text.find(what);
  const std::string before = text.substr(0, at);
  const auto line = std::count(before.begin(), before.end(), '\n') + 1;
  return std::to_string(line) + ":" + std::to_string(at - (before.rfind('\n') + 1) + 1);
}

std::uint64_t bits(double value) { return std::bit_cast<std::uint64_t>(value); }

TEST(BankFile, RoundTripsToTheBit) {
  Bank bank = hou_bank();
  bank.filters[0].F(0, 0) = 0.1;
  bank.filters[0].E << -0.0, std::numeric_limits<double>::denorm_min(), 1.0 / 3.0;
  bank.filters[0].G(0, 0) = -std::numeric_limits<double>::max();
  bank.filters[0].G(0, 1) = std::nextafter(1.0, 2.0);
  bank.domain = DesignDomain::kSampled;
  bank.disturbances = {{"d1", BankDisturbance::Treatment::kDecoupled},
                       {"d2", BankDisturbance::Treatment::kConstant},
                       {"d3"}};
  bank.isolability = {true, false, {{{0, 2}, {}}, {{0, 1, 2, 3}, {1.0, 0.5, -0.5, -0.5}}}, false};
  for (ResidualFilter& filter : bank.filters) {
    filter.certificate = {0.9,
                          {1e-16, 2.0, 3.0, 4.0},
                          {5.0, 6.0, 7.0},
                          {8.0, 9.0, 10.0, 11.0},
                          {0.1, 0.2, 0.3, 0.4},
                          {0.5, 0.6, 0.7, 0.8},
                          1.6,
                          {0.0, 0.01, 0.02, 0.03},
                          {0.0, 0.5, 0.6, 0.7},
                          {0.0, 0.07, 0.08, 0.09},
                          {2, 3, 0.1, 1e-16, 1e-11, 1e-7}};
  }
  bank.name = "quote \" backslash \\ umlaut \xC3\xBC";
  const Bank again = parse_bank(bank_text(bank), "b.json");
  EXPECT_EQ(bank_text(again), bank_text(bank));
  EXPECT_EQ(again.name, bank.name);
  EXPECT_EQ(again.plant_digest, bank.plant_digest);
  EXPECT_EQ(again.decision.settle, bank.decision.settle);
  EXPECT_EQ(again.domain, DesignDomain::kSampled);
  EXPECT_EQ(again.disturbances[1].treatment, BankDisturbance::Treatment::kConstant);
  ASSERT_EQ(again.isolability.confusable.size(), 2u);
  EXPECT_EQ(again.isolability.confusable[1].weights, bank.isolability.confusable[1].weights);
  EXPECT_FALSE(again.isolability.is_list_complete);
  ASSERT_EQ(again.filters.size(), bank.filters.size());
  for (std::size_t i = 0; i < bank.filters.size(); ++i) {
    const ResidualFilter& a = bank.filters[i];
    const ResidualFilter& b = again.filters[i];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.ignores, b.ignores);
    EXPECT_EQ(a.sees, b.sees);
    EXPECT_EQ(a.forget_samples, b.forget_samples);
    EXPECT_EQ(bits(a.threshold), bits(b.threshold));
    for (const auto matrix :
         {&ResidualFilter::F, &ResidualFilter::E, &ResidualFilter::G, &ResidualFilter::M,
          &ResidualFilter::H, &ResidualFilter::K, &ResidualFilter::L, &ResidualFilter::J}) {
      ASSERT_EQ((a.*matrix).size(), (b.*matrix).size());
      for (Eigen::Index j = 0; j < (a.*matrix).size(); ++j) {
        EXPECT_EQ(bits((a.*matrix).data()[j]), bits((b.*matrix).data()[j]));
      }
    }
    EXPECT_EQ(b.certificate.disturbance_gain, a.certificate.disturbance_gain);
    EXPECT_EQ(b.certificate.delay_s, a.certificate.delay_s);
    EXPECT_EQ(b.certificate.rank.tolerance_max, 1e-7);
  }
}

TEST(BankFile, RoundTripsAFilterWithoutAState) {
  Bank bank = hou_bank();
  ResidualFilter& filter = bank.filters[0];
  filter.F.resize(0, 0);
  filter.E.resize(0, 3);
  filter.G.resize(0, 4);
  filter.M.resize(1, 0);
  filter.L.resize(0, 4);
  const Bank again = parse_bank(bank_text(bank), "b.json");
  EXPECT_EQ(again.filters[0].F.size(), 0);
  EXPECT_EQ(again.filters[0].G.cols(), 4);
  EXPECT_EQ(again.filters[0].M.rows(), 1);
}

TEST(BankFile, WritesAndReadsAFile) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "bank_file_test";
  std::filesystem::create_directories(folder);
  const std::filesystem::path file = folder / "hou.bank.json";
  write_bank(hou_bank(), file);
  write_bank(hou_bank(), file);
  EXPECT_EQ(bank_text(read_bank(file)), bank_text(hou_bank()));
  // A folder cannot be replaced by a file; no temporary file is left, here or above.
  EXPECT_THROW(write_bank(hou_bank(), folder), std::system_error);
  for (const auto& entry : std::filesystem::directory_iterator(testing::TempDir())) {
    EXPECT_FALSE(entry.path().filename().string().starts_with("bank_file_test."));
  }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder), {}), 1);
}

TEST(BankFile, ThrowsASystemErrorForFilesThatCannotBeReadOrWritten) {
  EXPECT_THROW(static_cast<void>(read_bank("/nowhere/b.json")), std::system_error);
  EXPECT_THROW(static_cast<void>(read_bank("/")), std::system_error);
  EXPECT_THROW(write_bank(hou_bank(), "/nowhere/b.json"), std::system_error);
}

TEST(BankFile, LocatesSyntaxErrors) {
  EXPECT_THAT(refusal("{\n  \"schema\": 1,,\n}"), StartsWith("b.json:2:15: not JSON: "));
  EXPECT_THAT(refusal(""), StartsWith("b.json:1:1: not JSON: "));
  const std::string text = bank_text(hou_bank());
  EXPECT_THAT(refusal(text.substr(0, text.size() / 2)), HasSubstr(": not JSON: "));
}

TEST(BankFile, RefusesWhatIsNotANumber) {
  for (const char* const value : {"\"x\"", "null", "true", "[]", "{}"}) {
    EXPECT_THAT(refusal(with("[[0.9048374180359594]]", std::string("[[") + value + "]]")),
                HasSubstr("filters[0].F[0][0]: found "));
  }
  // JSON has no word for them, and a number too large for a double is not one.
  EXPECT_THAT(refusal(with("0.9048374180359594", "NaN")), HasSubstr("not JSON"));
  EXPECT_THAT(refusal(with("0.9048374180359594", "1e999")), HasSubstr("not JSON"));
}

TEST(BankFile, LocatesSemanticErrors) {
  EXPECT_EQ(refusal(with("\"threshold\": 0.05", "\"threshold\": -1.5")),
            "b.json:" + place_of("0.05,\n      \"forget") +
                ": filters[0].threshold: found number -1.5, expected a positive number");
  EXPECT_EQ(
      refusal(with("\"none\", \"none\", \"steady\"", "\"none\", \"none\", \"firmly\"")),
      "b.json:" + place_of("\"steady\"") +
          ": filters[0].sees[2]: found string \"firmly\", expected \"none\", \"transient\" or "
          "\"steady\"");
  EXPECT_EQ(refusal(with("0.9048374180359594", "1.5")),
            "b.json:" + place_of("[[0.9048374180359594]]") +
                ": filters[0].F: found spectral radius 1.5, expected a stable filter (below 1)");
  EXPECT_EQ(refusal(with("\"settle\"", "\"setle\"")),
            "b.json:" + place_of("\"settle\"") +
                ": decision: found unknown key \"setle\", expected one of dwell, settle, window, "
                "clearing");
  EXPECT_EQ(refusal(with("\"schema\": 1", "\"schema\": 2")),
            "b.json:2:13: schema: found number 2, expected 1");
  EXPECT_EQ(refusal(with("  \"schema\": 1,\n", "")),
            "b.json:1:1: found no \"schema\", expected it");
  EXPECT_EQ(refusal("[1]"), "b.json:1:1: found a list of 1 values, expected an object");
  EXPECT_EQ(refusal("17"), "b.json:1:1: found number 17, expected an object");
}

TEST(BankFile, RefusesThresholdsThatCannotBe) {
  const auto beside = [](const std::string& member) {
    return refusal(with("\"certificate\": {", member + ", \"certificate\": {"));
  };
  const std::string test =
      R"("test": {"kind": "cusum", "reference": 0.25, "window": 0, "offset": [0.0]})";
  EXPECT_EQ(beside(test), "");
  const auto other = [&](const std::string& from, const std::string& to) {
    std::string changed = test;
    return beside(changed.replace(changed.find(from), from.size(), to));
  };
  EXPECT_THAT(other("cusum", "sum"),
              HasSubstr("filters[0].test.kind: found string \"sum\", expected"));
  EXPECT_THAT(other("0.25", "0"),
              HasSubstr("filters[0].test.reference: found number 0, expected a positive"));
  EXPECT_THAT(other("0.25", "-1"), HasSubstr("filters[0].test.reference: found number -1"));
  EXPECT_THAT(other("[0.0]", "[]"), HasSubstr("filters[0].test.offset: found"));
  EXPECT_THAT(other("[0.0]", "[-0.1]"), HasSubstr("filters[0].test.offset[0]: found number -0.1"));
  EXPECT_THAT(other("cusum", "glr"), HasSubstr("filters[0].test.window: found number 0"));
  EXPECT_THAT(other("cusum\", \"reference\": 0.25, \"window\": 0",
                    "glr\", \"reference\": 0, \"window\": 4000000000"),
              HasSubstr("filters[0].test.window: found"));
  EXPECT_THAT(beside(R"("shares": {"disturbance": [0]})"), HasSubstr("filters[0].shares"));
  EXPECT_THAT(beside(R"("calibration": {"hours": 0})"), HasSubstr("filters[0].calibration"));
  EXPECT_THAT(
      refusal(with(
          "\"isolability\"",
          R"("thresholds": {"kind": "guessed", "output_resolution": [], "jitter_s": 0, "false_alarms_per_h": 0}, "isolability")")),
      HasSubstr("thresholds.kind: found string \"guessed\""));
  EXPECT_THAT(
      refusal(with(
          "\"isolability\"",
          R"("thresholds": {"kind": "given", "output_resolution": [1], "jitter_s": 0, "false_alarms_per_h": 0}, "isolability")")),
      HasSubstr("thresholds.output_resolution: found"));
}

TEST(BankFile, RefusesContradictions) {
  EXPECT_THAT(refusal(with("\"none\", \"none\", \"steady\"", "\"steady\", \"none\", \"steady\"")),
              HasSubstr("filters[0].sees[0]: found string \"steady\", expected \"none\" for an "
                        "ignored fault"));
  EXPECT_THAT(refusal(with("\"name\": \"r13\"", "\"name\": \"r12\"")),
              HasSubstr("filters[1]: found a second filter \"r12\""));
  EXPECT_THAT(refusal(with("\"schema\": 1", "\"schema\": 1, \"schema\": 1")),
              HasSubstr("found key \"schema\" twice"));
  EXPECT_THAT(refusal(with("\"ignores\": [\"u1\", \"u2\"]", "\"ignores\": [\"u1\", \"u1\"]")),
              HasSubstr("filters[0].ignores[1]: found string \"u1\""));
  EXPECT_THAT(refusal(with("\"u2\", \"u3\"", "\"u1\", \"u3\"")), HasSubstr("inputs[1]"));
}

TEST(BankFile, RefusesWrongShapes) {
  EXPECT_THAT(refusal(with("[[0.9048374180359594]]", "[[0.5, 0.1]]")),
              HasSubstr("filters[0].F[0]: found a list of 2 values, expected a list of 1 values"));
  EXPECT_THAT(refusal(with("\"fault_sizes\": [1.0, ", "\"fault_sizes\": [")),
              HasSubstr("fault_sizes: found a list of 3 values, expected a list of 4 values"));
}

TEST(BankFile, BoundsWhatAHostileFileCanAskFor) {
  EXPECT_THAT(refusal(std::string(100000, '[')), HasSubstr("nested deeper than"));
  std::string faults = "\"faults\": [";
  std::string sizes = "\"fault_sizes\": [";
  for (int j = 0; j < 64; ++j) {
    faults += (j == 0 ? "\"f" : ", \"f") + std::to_string(j) + "\"";
    sizes += j == 0 ? "1" : ", 1";
  }
  std::string text = with("\"faults\": [\"u1\", \"u2\", \"u3\", \"u4\"", faults);
  const auto replace = [&](const std::string& from, const std::string& to) {
    text.replace(text.find(from), from.size(), to);
  };
  replace("\"fault_sizes\": [1.0, 1.0, 1.0, 1.0", sizes);
  replace("\"concurrent\": 2", "\"concurrent\": 32");
  EXPECT_THAT(refusal(text), HasSubstr("concurrent: found 32 of 64 faults"));
}

TEST(BankFile, SurvivesEveryTruncationAndEverySingleByteChange) {
  const std::string text = bank_text(hou_bank());
  for (std::size_t i = 0; i < text.size(); i += 7) {
    EXPECT_NE(refusal(text.substr(0, i)), "") << i;
    std::string changed = text;
    changed[i] = static_cast<char>(changed[i] ^ 0x15);
    static_cast<void>(refusal(changed));  // may be read or refused, nothing else
  }
}

}  // namespace
}  // namespace faultline

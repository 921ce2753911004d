#include "diagnosis/design/bank_request.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/input_error.h"
#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

using ::testing::StartsWith;

std::string with(const std::string& from, const std::string& to) {
  std::string text = hou_request_text(true, 3);
  text.replace(text.find(from), from.size(), to);
  return text;
}

std::string refusal(const std::string& text) {
  try {
    static_cast<void>(parse_bank_request(text, "bank.toml"));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(BankRequest, ReadsEveryKey) {
  const BankRequest request = parse_bank_request(R"(schema = 1
name = "b"
plant = "../p/plant.toml"
method = "geometric"
concurrent = 2
poles = [-10, [-3, 4], [-3.0, -4.0]]
domain = "sampled"
sample_time_s = 0.02
decouple = ["d1"]
normalise = false
structure = "all"
[decision]
threshold = 0.5
dwell = 4
settle = 5
)",
                                                 "examples/x/bank.toml");
  EXPECT_EQ(request.name, "b");
  EXPECT_EQ(request.plant, "examples/x/../p/plant.toml");
  EXPECT_EQ(request.concurrent, 2u);
  EXPECT_EQ(request.poles, (std::vector<std::complex<double>>{-10.0, {-3, 4}, {-3, -4}}));
  EXPECT_EQ(request.domain, DesignDomain::kSampled);
  EXPECT_EQ(request.sample_time_s, 0.02);
  EXPECT_EQ(request.decouple, std::vector<std::string>{"d1"});
  EXPECT_FALSE(request.normalise);
  EXPECT_EQ(request.threshold, 0.5);
  EXPECT_EQ(request.decision.dwell, 4u);
  EXPECT_EQ(request.decision.settle, 5u);
}

TEST(BankRequest, HasDefaultsForWhatIsUsual) {
  const BankRequest request = parse_bank_request(
      "schema = 1\nname = \"b\"\nplant = \"plant.toml\"\nmethod = \"geometric\"\npoles = [-1]\n"
      "sample_time_s = 0.01\n[decision]\nthreshold = 1\n",
      "bank.toml");
  EXPECT_EQ(request.plant, "plant.toml");
  EXPECT_EQ(request.concurrent, 1u);
  EXPECT_EQ(request.domain, DesignDomain::kContinuous);
  EXPECT_TRUE(request.normalise);
  EXPECT_EQ(request.decision.dwell, 3u);
  EXPECT_EQ(request.decision.settle, 3u);
}

TEST(BankRequest, RefusesWhatThisVersionCannotDoAndSaysWhatItCan) {
  EXPECT_EQ(refusal(with("\"geometric\"", "\"parity\"")),
            "bank.toml:4:10: method: found \"parity\", expected one of \"geometric\", "
            "\"eigenstructure\", \"uio\"");
  EXPECT_EQ(
      refusal(with("threshold = 0.05", "threshold = \"quadratic\"")),
      "bank.toml:10:13: decision.threshold: found \"quadratic\", expected one of \"certified\", "
      "\"calibrated\"");
  EXPECT_THAT(refusal(hou_request_text(true, 3) + "[uio]\n"),
              StartsWith("bank.toml:12:2: found unknown key \"uio\""));
}

TEST(BankRequest, TakesAStructureAsAWordOrAsSets) {
  const auto parse = [](const std::string& line) {
    return parse_bank_request(with("normalise     = true", line), "bank.toml");
  };
  EXPECT_EQ(parse("").structure, StructureChoice::kAll);
  EXPECT_EQ(parse("structure = \"all\"").structure, StructureChoice::kAll);
  EXPECT_EQ(parse("structure = \"smallest\"").structure, StructureChoice::kSmallest);
  const BankRequest given = parse("structure = [[\"u1\"], [\"u2\", \"u3\"], []]");
  EXPECT_EQ(given.structure, StructureChoice::kGiven);
  EXPECT_EQ(given.ignored_sets, (std::vector<std::vector<std::string>>{{"u1"}, {"u2", "u3"}, {}}));
  EXPECT_THAT(refusal(with("normalise     = true", "structure = \"few\"")),
              StartsWith("bank.toml:8:13: structure: found \"few\", expected "));
}

TEST(BankRequest, TakesADecayRateInsteadOfPoles) {
  const BankRequest request =
      parse_bank_request(with("poles         = [-10.0]", "decay_rate_per_s = 4.0"), "bank.toml");
  EXPECT_EQ(request.decay_rate_per_s, 4.0);
  EXPECT_TRUE(request.poles.empty());
  EXPECT_EQ(refusal(with("normalise     = true", "decay_rate_per_s = 4.0")),
            "bank.toml:8:20: decay_rate_per_s: found it beside \"poles\", expected one of the two");
  EXPECT_THAT(refusal(with("poles         = [-10.0]", "decay_rate_per_s = 0.0")),
              StartsWith("bank.toml:6:20: decay_rate_per_s: found 0, expected a positive number"));
}

TEST(BankRequest, TakesAWindowForTheFaultSize) {
  EXPECT_FALSE(parse_bank_request(hou_request_text(true, 3), "bank.toml").window.has_value());
  EXPECT_EQ(parse_bank_request(hou_request_text(true, 3) + "window = 80\n", "bank.toml").window,
            80u);
}

TEST(BankRequest, RefusesWrongNumbers) {
  EXPECT_EQ(refusal(with("concurrent    = 2", "concurrent = 0")),
            "bank.toml:5:14: concurrent: found 0, expected a whole number from 1");
  EXPECT_EQ(refusal(with("threshold = 0.05", "threshold = 0.0")),
            "bank.toml:10:13: decision.threshold: found 0, expected a positive number");
  EXPECT_EQ(refusal(with("sample_time_s = 0.01", "sample_time_s = nan")),
            "bank.toml:7:17: sample_time_s: found number nan, expected a finite number");
  EXPECT_EQ(
      refusal(with("[-10.0]", "[[-1, 2, 3]]")),
      "bank.toml:6:18: poles, entry 1: found a list of 3 values, expected a list of 2 numbers");
}

TEST(BankRequest, RefusesAnotherSchema) {
  EXPECT_EQ(refusal(with("schema = 1", "schema = 2")),
            "bank.toml:1:10: schema: found 2, expected 1");
}

}  // namespace
}  // namespace faultline

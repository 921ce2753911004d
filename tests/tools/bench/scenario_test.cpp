#include "tools/bench/scenario.h"

#include <fstream>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/input_error.h"
#include "tests/tools/bench/log_comparison.h"

namespace faultline {
namespace {

using testing::HasSubstr;

constexpr char kHead[] = R"(schema = 1
name = "s"
plant = "p.toml"
bank = "b.toml"
dbc = "d.dbc"
duration_s = 10.0
)";

class ScenarioTest : public testing::Test {
 protected:
  Scenario read(const std::string& rest) {
    const std::filesystem::path file = folder_.path() / "s.toml";
    std::ofstream(file) << kHead << rest;
    return read_scenario(file);
  }
  std::string refusal(const std::string& rest) {
    try {
      read(rest);
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  }
  TemporaryFolder folder_;
};

TEST_F(ScenarioTest, ReadsEveryKindOfEntry) {
  const Scenario scenario = read(R"(
bus = "can:vcan3"
seed = 7
initial_state = [1, 2]
initial_state_known = true
[controller]
kind = "gain"
K = [[1, 2]]
feedforward = [3]
[[fault]]
target = "u1"
kind = "gain"
value = 0.5
at_s = 1
until_s = 2
ramp_s = 0.5
period_s = 0.25
[[expect]]
from_s = 1
until_s = 2
verdict = "isolated"
faults = ["u2", "u1"]
[signals]
u1 = "Message.Signal"
y1 = { signal = "Other", scale = 2.0, offset = -1, sign = -1 }
)");
  EXPECT_EQ(scenario.bus, "can:vcan3");
  EXPECT_EQ(scenario.seed, 7);
  EXPECT_EQ(scenario.plant, folder_.path() / "p.toml");
  EXPECT_TRUE(scenario.is_initial_state_known);
  EXPECT_EQ(scenario.initial_state->size(), 2);
  EXPECT_EQ(scenario.controller.kind, ControllerKind::kGain);
  EXPECT_EQ((*scenario.controller.K)(0, 1), 2.0);
  ASSERT_EQ(scenario.injections.size(), 1U);
  EXPECT_EQ(scenario.injections[0].kind, InjectionKind::kGain);
  EXPECT_EQ(scenario.injections[0].until_s, 2.0);
  EXPECT_EQ(scenario.injections[0].period_s, 0.25);
  ASSERT_EQ(scenario.expectations.size(), 1U);
  EXPECT_THAT(scenario.expectations[0].faults, testing::ElementsAre("u1", "u2"));
  EXPECT_EQ(scenario.signals.at("u1").signal, "Message.Signal");
  EXPECT_EQ(scenario.signals.at("y1").scale, -2.0);
  EXPECT_EQ(scenario.signals.at("y1").offset, -1.0);
}

TEST_F(ScenarioTest, ReadsHowThePlantIsSimulatedAndWhatDisturbsIt) {
  const Scenario scenario = read(R"(
[simulation]
method = "rk4"
substeps = 25
[[fault]]
target = "u1"
kind = "sinusoid"
value = 0.1
at_s = 10
frequency_Hz = 5
phase_rad = -1.5
[[disturbance]]
target = "all"
kind = "uniform"
[[disturbance]]
target = "wind"
kind = "constant"
size = -0.25
at_s = 3
until_s = 4
[[noise]]
target = "noise1"
kind = "sinusoid"
size = 0.5
frequency_Hz = 50
phase_rad = 1
)");
  EXPECT_EQ(scenario.simulation.integration.method, IntegrationMethod::kRk4);
  EXPECT_EQ(scenario.simulation.integration.substeps, 25);
  ASSERT_EQ(scenario.injections.size(), 1U);
  EXPECT_EQ(scenario.injections[0].kind, InjectionKind::kSinusoid);
  EXPECT_EQ(scenario.injections[0].frequency_Hz, 5.0);
  EXPECT_EQ(scenario.injections[0].phase_rad, -1.5);
  ASSERT_EQ(scenario.disturbances.size(), 2U);
  EXPECT_EQ(scenario.disturbances[0].target, "all");
  EXPECT_EQ(scenario.disturbances[0].kind, PerturbationKind::kUniform);
  EXPECT_FALSE(scenario.disturbances[0].size);
  EXPECT_EQ(scenario.disturbances[1].kind, PerturbationKind::kConstant);
  EXPECT_EQ(scenario.disturbances[1].size, -0.25);
  EXPECT_EQ(scenario.disturbances[1].at_s, 3.0);
  EXPECT_EQ(scenario.disturbances[1].until_s, 4.0);
  ASSERT_EQ(scenario.noises.size(), 1U);
  EXPECT_EQ(scenario.noises[0].kind, PerturbationKind::kSinusoid);
  EXPECT_EQ(scenario.noises[0].frequency_Hz, 50.0);
  EXPECT_EQ(scenario.noises[0].phase_rad, 1.0);
}

TEST_F(ScenarioTest, LeavesTheMethodToThePlantUnlessItIsTold) {
  EXPECT_FALSE(read("").simulation.integration.method);
  EXPECT_EQ(read("[simulation]\nmethod = \"euler\"\n").simulation.integration.method,
            IntegrationMethod::kEuler);
}

TEST_F(ScenarioTest, PointsAtWhatIsWrongInTheSimulation) {
  EXPECT_THAT(refusal("[simulation]\nmethod = \"rk5\"\n"), HasSubstr("s.toml:8:10: "));
  EXPECT_THAT(refusal("[simulation]\nsubsteps = 5\n"),
              HasSubstr("simulation.method: found nothing"));
  EXPECT_THAT(
      refusal("[simulation]\nmethod = \"zoh\"\nsubsteps = 5\n"),
      HasSubstr("s.toml:9:12: simulation.substeps: found it with method = \"zoh\", expected "
                "it with \"rk4\" only"));
  for (const char* substeps : {"0", "-1", "1001"}) {
    EXPECT_THAT(
        refusal(std::string("[simulation]\nmethod = \"rk4\"\nsubsteps = ") + substeps + "\n"),
        HasSubstr("s.toml:9:12: simulation.substeps: found"));
  }
}

TEST_F(ScenarioTest, PointsAtWhatIsWrongInADisturbanceOrNoise) {
  const std::string head = "[[noise]]\ntarget = \"all\"\nkind = ";
  EXPECT_THAT(refusal(head + "\"pink\"\n"), HasSubstr("s.toml:9:8: "));
  EXPECT_THAT(refusal(head + "\"uniform\"\nsize = 0\n"), HasSubstr("s.toml:10:8: "));
  EXPECT_THAT(refusal(head + "\"uniform\"\nsize = -1\n"), HasSubstr("s.toml:10:8: "));
  EXPECT_THAT(refusal(head + "\"uniform\"\nsize = nan\n"), HasSubstr("s.toml:10:8: "));
  EXPECT_THAT(refusal(head + "\"uniform\"\nfrequency_Hz = 1\n"),
              HasSubstr("unknown key \"frequency_Hz\""));
  EXPECT_THAT(refusal(head + "\"sinusoid\"\n"), HasSubstr("frequency_Hz: found nothing"));
  EXPECT_THAT(refusal(head + "\"sinusoid\"\nfrequency_Hz = 0\n"), HasSubstr("s.toml:10:16: "));
  EXPECT_THAT(refusal(head + "\"constant\"\nat_s = -1\n"), HasSubstr("s.toml:10:8: "));
  EXPECT_THAT(
      refusal(head + "\"constant\"\nat_s = 2\nuntil_s = 2\n"),
      HasSubstr("s.toml:11:11: noise, entry 1.until_s: found 2, expected more than at_s = 2"));
  EXPECT_THAT(refusal("[[disturbance]]\nkind = \"uniform\"\n"), HasSubstr("target: found nothing"));
  EXPECT_THAT(refusal("[[fault]]\ntarget = \"u1\"\nkind = \"sinusoid\"\nvalue = 1\nat_s = 1\n"),
              HasSubstr("fault, entry 1.frequency_Hz: found nothing"));
  EXPECT_THAT(refusal("[[fault]]\ntarget = \"u1\"\nkind = \"bias\"\nvalue = 1\nat_s = 1\n"
                      "phase_rad = 1\n"),
              HasSubstr("phase_rad: found it with kind = \"bias\", which does not use it"));
}

TEST_F(ScenarioTest, PointsAtWhatIsWrong) {
  EXPECT_THAT(refusal("durations = 3\n"), HasSubstr("s.toml:7:"));
  EXPECT_THAT(refusal("[controller]\nkind = \"mpc\"\n"), HasSubstr("s.toml:8:"));
  EXPECT_THAT(refusal("[[fault]]\ntarget = \"u1\"\nkind = \"bias\"\nvalue = nan\nat_s = 1\n"),
              HasSubstr("s.toml:10:"));
  EXPECT_THAT(refusal("[[fault]]\ntarget = \"u1\"\nkind = \"bias\"\nvalue = 1\nat_s = -1\n"),
              HasSubstr("s.toml:11:"));
  EXPECT_THAT(refusal("[[expect]]\nfrom_s = 2\nuntil_s = 1\nverdict = \"healthy\"\n"),
              HasSubstr("s.toml:9:"));
  EXPECT_THAT(refusal("[[expect]]\nfrom_s = 1\nuntil_s = 2\nverdict = \"broken\"\n"),
              HasSubstr("s.toml:10:"));
  EXPECT_THAT(
      refusal("[[expect]]\nfrom_s = 1\nuntil_s = 2\nverdict = \"healthy\"\nfaults = [\"u1\"]\n"),
      HasSubstr("s.toml:11:"));
  EXPECT_THAT(refusal("[signals]\nu1 = { signal = \"X\", sign = 2 }\n"), HasSubstr("s.toml:8:"));
  EXPECT_THAT(refusal("[signals]\nu1 = { signal = \"X\", scale = 0 }\n"), HasSubstr("s.toml:8:"));
}

/// [[expect]] from 1 to 2 s with `rest`, on lines 8 to 10 and on.
std::string expect(const std::string& rest) {
  return "[[expect]]\nfrom_s = 1\nuntil_s = 2\n" + rest + "\n";
}

TEST_F(ScenarioTest, ReadsWhatADiagnosisMayBeExpectedToAnswer) {
  const Scenario scenario = read(expect(R"(verdict = ["isolated", "ambiguous"]
faults = ["u2", "u1"]
sets = [["u3", "u2"], ["u1"]]
within_s = 0.5
estimate = { u1 = 2, u2 = -1.5 }
tolerance = { u1 = 0.1, u2 = 0.2 })") +
                                 R"([[expect]]
from_s = 0
until_s = 0.5
verdict = "healthy"
no_false_alarm = true
)");
  ASSERT_EQ(scenario.expectations.size(), 2U);
  const Expectation& all = scenario.expectations[0];
  EXPECT_THAT(all.verdicts, testing::ElementsAre(Verdict::kIsolated, Verdict::kAmbiguous));
  EXPECT_THAT(all.faults, testing::ElementsAre("u1", "u2"));
  EXPECT_THAT(all.sets,
              testing::ElementsAre(testing::ElementsAre("u1"), testing::ElementsAre("u2", "u3")));
  EXPECT_FALSE(all.may_have_more_sets);
  EXPECT_EQ(all.within_s, 0.5);
  ASSERT_EQ(all.estimates.size(), 2U);
  EXPECT_EQ(all.estimates[1].fault, "u2");
  EXPECT_EQ(all.estimates[1].value, -1.5);
  EXPECT_EQ(all.estimates[1].tolerance, 0.2);
  EXPECT_TRUE(scenario.expectations[1].has_no_false_alarm);
}

TEST_F(ScenarioTest, LeavesOutTheVerdictWhereTheRestSaysIt) {
  const Scenario blame = read(expect("blame = \"S\"\nblame_fault = [\"wrong CRC\", \"missing\"]"));
  EXPECT_THAT(blame.expectations[0].verdicts, testing::ElementsAre(Verdict::kInhibited));
  EXPECT_THAT(blame.expectations[0].blamed, testing::ElementsAre("S"));
  EXPECT_EQ(expectation_words(blame.expectations[0]),
            "1 .. 2 s  inhibited; blamed on S: wrong CRC or missing");
  const Scenario quiet = read(expect("no_false_alarm = true"));
  EXPECT_THAT(quiet.expectations[0].verdicts,
              testing::ElementsAre(Verdict::kHealthy, Verdict::kInhibited));
  const Scenario sets = read(expect("verdict = \"ambiguous\"\nsets = { includes = [[\"a\"]] }"));
  EXPECT_TRUE(sets.expectations[0].may_have_more_sets);
  EXPECT_EQ(expectation_words(sets.expectations[0]), "1 .. 2 s  ambiguous a among others");
}

TEST_F(ScenarioTest, LeavesOpenWhatIsIsolatedBesideOtherVerdicts) {
  const Scenario any = read(expect("verdict = [\"ambiguous\", \"isolated\"]") +
                            expect("verdict = \"isolated\"\nfaults = [\"u1\"]"));
  EXPECT_TRUE(any.expectations[0].faults.empty());
  EXPECT_EQ(expectation_words(any.expectations[0]), "1 .. 2 s  isolated or ambiguous");
  EXPECT_EQ(any.expectations.size(), 2U) << "they do not contradict each other";
}

TEST_F(ScenarioTest, RefusesWhatNoDiagnosisCanMeet) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"faults = [\"u1\"]", "expect, entry 1.verdict: found nothing"},
      {"verdict = []", "s.toml:10:11: expect, entry 1.verdict: found an empty list"},
      {"verdict = [\"healthy\", \"isolatd\"]", "did you mean \"isolated\"?"},
      {"verdict = [\"healthy\", \"healthy\"]", "found \"healthy\" twice"},
      {"verdict = \"isolated\"", "faults: found nothing"},
      {"verdict = \"isolated\"\nfaults = [\"u1\", \"u1\"]", "s.toml:11:10: "},
      {"verdict = \"isolated\"\nfaults = []", "faults: found an empty list"},
      {"verdict = \"healthy\"\nsets = [[\"a\"], [\"b\"]]", "it goes with \"ambiguous\" only"},
      {"verdict = \"ambiguous\"\nsets = [[\"a\"]]", "found 1 fault set, expected 2 to 8"},
      {"verdict = \"ambiguous\"\nsets = [[\"a\"], [\"a\"]]", "found the set a twice"},
      {"verdict = \"ambiguous\"\nsets = { includs = [[\"a\"]] }", "sets.includes: found nothing"},
      {"verdict = \"healthy\"\nwithin_s = 1.5",
       "s.toml:11:12: expect, entry 1.within_s: found 1.5, "
       "expected at most until_s - from_s = 1"},
      {"verdict = \"healthy\"\nwithin_s = -1", "s.toml:11:12: "},
      {"no_false_alarm = true\nwithin_s = 1", "within_s: found it without a verdict"},
      {"no_false_alarm = true\nverdict = \"unexplained\"", "found \"unexplained\" with no_false"},
      {"verdict = \"healthy\"\nestimate = { u1 = 1 }\ntolerance = 1", "with \"isolated\" only"},
      {"verdict = \"isolated\"\nfaults = [\"u1\"]\nestimate = { u2 = 1 }\ntolerance = 1",
       "s.toml:12:19: expect, entry 1.estimate.u2: found no such name in faults"},
      {"verdict = \"isolated\"\nfaults = [\"u1\"]\nestimate = { u1 = 1 }",
       "tolerance: found nothing"},
      {"verdict = \"isolated\"\nfaults = [\"u1\"]\nestimate = { u1 = 1 }\ntolerance = -1",
       "s.toml:13:13: "},
      {"verdict = \"isolated\"\nfaults = [\"u1\"]\nestimate = { }\ntolerance = 1",
       "estimate: found an empty table"},
      {"verdict = \"isolated\"\nfaults = [\"u1\"]\ntolerance = 1", "found it without estimate"},
      {"verdict = \"healthy\"\nblame = \"S\"", "blame: found it with the verdict \"healthy\""},
      {"blame = \"S\"\nblame_fault = \"wrong crc\"", "did you mean \"wrong CRC\"?"},
      {"verdict = \"healthy\"\nblame_falt = \"S\"", "unknown key \"blame_falt\""}};
  for (const auto& [rest, refused] : cases) {
    EXPECT_THAT(refusal(expect(rest)), HasSubstr(refused)) << rest;
  }
}

TEST_F(ScenarioTest, RefusesExpectationsThatContradictEachOther) {
  const auto isolated = [](const char* fault, const char* more = "") {
    return expect(fmt::format("verdict = \"isolated\"\nfaults = [\"{}\"]\n{}", fault, more));
  };
  const std::string healthy = expect("verdict = \"healthy\"");
  EXPECT_THAT(refusal(healthy + isolated("a")),
              HasSubstr("s.toml:12:10: expect, entry 2.from_s: found 1 .. 2 s  isolated a, which "
                        "contradicts entry 1 (1 .. 2 s  healthy)"));
  EXPECT_THAT(refusal(isolated("b") + isolated("a")), HasSubstr("contradicts entry 1"));
  EXPECT_EQ(refusal(isolated("a") + isolated("a")), "accepted");
  EXPECT_EQ(refusal(healthy + expect("no_false_alarm = true")), "accepted");
  EXPECT_THAT(refusal(isolated("a") + expect("no_false_alarm = true")), HasSubstr("contradicts"));
  EXPECT_THAT(refusal(expect("blame = \"A\"") + expect("blame = \"B\"")), HasSubstr("contradicts"));
  EXPECT_EQ(refusal(expect("blame = [\"A\", \"C\"]") + expect("blame = [\"B\", \"C\"]")),
            "accepted");
  // One ends when the other begins: it may, if the second has time.
  const std::string next = "[[expect]]\nfrom_s = 2\nuntil_s = 3\nverdict = \"inhibited\"\n";
  EXPECT_THAT(refusal(healthy + next), HasSubstr("contradicts"));
  EXPECT_EQ(refusal(healthy + next + "within_s = 0.1\n"), "accepted");
}

/// A scenario that includes files of its folder, which the test writes.
class ScenarioIncludeTest : public ScenarioTest {
 protected:
  void write(const std::string& name, const std::string& text) {
    const std::filesystem::path file = folder_.path() / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file) << text;
  }
  Scenario read_whole(const std::string& text) {
    write("s.toml", text);
    return read_scenario(folder_.path() / "s.toml");
  }
  std::string refusal_of_whole(const std::string& text) {
    try {
      read_whole(text);
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  }
};

constexpr char kCommon[] = R"(schema = 1
plant = "p.toml"
bank = "b.toml"
dbc = "d.dbc"
duration_s = 10.0
seed = 4
[signals]
y1 = { signal = "A", scale = 2.0 }
y2 = "B"
[[fault]]
target = "u1"
kind = "bias"
value = 1.0
at_s = 1.0
)";

TEST_F(ScenarioIncludeTest, TakesOverWhatItDoesNotSayItself) {
  write("parts/common.toml", kCommon);
  const Scenario scenario = read_whole(R"(name = "s"
include = ["parts/common.toml"]
bank = "own.toml"
seed = 5
[signals]
y1 = "C"
[[fault]]
target = "u2"
kind = "bias"
value = 2.0
at_s = 2.0
)");
  EXPECT_EQ(scenario.plant, folder_.path() / "parts/p.toml") << "relative to where it is written";
  EXPECT_EQ(scenario.bank, folder_.path() / "own.toml");
  EXPECT_EQ(scenario.seed, 5);
  EXPECT_EQ(scenario.duration_s, 10.0);
  EXPECT_EQ(scenario.signals.at("y1").signal, "C");
  EXPECT_EQ(scenario.signals.at("y1").scale, 1.0) << "an inline table is one value";
  EXPECT_EQ(scenario.signals.at("y2").signal, "B");
  ASSERT_EQ(scenario.injections.size(), 2U);
  EXPECT_EQ(scenario.injections[0].target, "u1") << "included ones come first";
  EXPECT_EQ(scenario.injections[1].target, "u2");
  ASSERT_EQ(scenario.includes.size(), 1U);
  EXPECT_EQ(scenario.includes[0].name, "parts/common.toml");
  EXPECT_EQ(scenario.includes[0].text, kCommon);
}

TEST_F(ScenarioIncludeTest, LetsTheLaterIncludeHoldAndTakesEachFileOnce) {
  write("common.toml", kCommon);
  write("a.toml", "include = [\"common.toml\"]\nseed = 6\n");
  write("b.toml", "include = [\"common.toml\"]\nseed = 7\nduration_s = 20.0\n");
  const Scenario scenario = read_whole("name = \"s\"\ninclude = [\"a.toml\", \"b.toml\"]\n");
  EXPECT_EQ(scenario.seed, 7);
  EXPECT_EQ(scenario.duration_s, 20.0);
  EXPECT_EQ(scenario.injections.size(), 1U);
  EXPECT_EQ(scenario.includes.size(), 3U);
}

TEST_F(ScenarioIncludeTest, PointsToTheFileWhereItReallyStands) {
  write("parts/common.toml", std::string(kCommon) + "until_s = 0.5\n");
  const std::string head = "name = \"s\"\ninclude = [\"parts/common.toml\"]\n";
  EXPECT_THAT(refusal_of_whole(head), HasSubstr("parts/common.toml:15:11: fault, entry 1.until_s"));
  write("parts/common.toml", std::string(kCommon) + "valu = 0.5\n");
  EXPECT_THAT(refusal_of_whole(head),
              HasSubstr("parts/common.toml:15:1: fault, entry 1: found unknown key \"valu\""));
  write("parts/common.toml", std::string(kCommon) + "x = [\n");
  EXPECT_THAT(refusal_of_whole(head), HasSubstr("parts/common.toml:1"));
  write("parts/common.toml", kCommon);
  EXPECT_THAT(refusal_of_whole(head + "durations_s = 3\n"), HasSubstr("/s.toml:3:1: "));
  EXPECT_THAT(refusal_of_whole(head + "duration_s = -3\n"), HasSubstr("/s.toml:3:14: "));
  EXPECT_THAT(refusal_of_whole(head + "[[fault]]\nkind = \"bias\"\n"),
              HasSubstr("/s.toml:3:1: fault, entry 2.target: found nothing"));
  // What shows later, beside other files.
  const Scenario scenario = read_whole(head + "seed = 1\n");
  const auto place = [&](std::string_view table, std::string_view key,
                         std::optional<std::size_t> entry = std::nullopt) {
    return std::string(scenario_error(scenario, table, key, "x", entry).what());
  };
  EXPECT_THAT(place("fault", "target", 0), HasSubstr("parts/common.toml:11:10: x"));
  EXPECT_THAT(place("signals", "y2"), HasSubstr("parts/common.toml:9:6: x"));
  EXPECT_THAT(place("", "seed"), HasSubstr("/s.toml:3:8: x"));
  EXPECT_THAT(place("", "bank"), HasSubstr("parts/common.toml:3:8: x"));
  EXPECT_THAT(place("simulation", "method"), HasSubstr("/s.toml:1:1: x")) << "there is none";
}

TEST_F(ScenarioIncludeTest, RefusesCyclesAndWhatIsNotThere) {
  write("a.toml", "include = [\"sub/b.toml\"]\n");
  write("sub/b.toml", "seed = 1\ninclude = [\"../a.toml\"]\n");
  const std::string head = "name = \"s\"\n";
  EXPECT_THAT(refusal_of_whole(head + "include = [\"a.toml\"]\n"),
              HasSubstr("sub/b.toml:2:11: include: found a cycle s.toml -> a.toml -> sub/b.toml -> "
                        "a.toml, expected files that do not include themselves"));
  EXPECT_THAT(refusal_of_whole(head + "include = [\"s.toml\"]\n"),
              HasSubstr("found a cycle s.toml -> s.toml"));
  EXPECT_THAT(refusal_of_whole(head + "include = [\"none.toml\"]\n"),
              HasSubstr("/s.toml:2:11: include: found no file "));
  EXPECT_THAT(refusal_of_whole(head + "include = [\"sub\"]\n"), HasSubstr("found no file "));
  EXPECT_THAT(refusal_of_whole(head + "include = \"a.toml\"\n"), HasSubstr("expected a list of"));
  write("named.toml", "name = \"t\"\n");
  EXPECT_THAT(refusal_of_whole(head + "include = [\"named.toml\"]\n"),
              HasSubstr("named.toml:1:8: name: found one in an included file"));
  write("other.toml", "schema = 2\n");
  EXPECT_THAT(refusal_of_whole(head + "include = [\"other.toml\"]\n"),
              HasSubstr("other.toml:1:10: schema: found 2, expected 1"));
  for (int i = 0; i < 40; ++i) {
    write(fmt::format("n{}.toml", i), fmt::format("include = [\"n{}.toml\"]\n", i + 1));
  }
  EXPECT_THAT(refusal_of_whole(head + "include = [\"n0.toml\"]\n"), HasSubstr("inside each other"));
}

TEST_F(ScenarioIncludeTest, NeedsNothingButTheTextsOfALog) {
  write("parts/common.toml", std::string("include = [\"../more.toml\"]\n") + kCommon);
  write("more.toml", "initial_state_known = true\n");
  const Scenario scenario = read_whole("name = \"s\"\ninclude = [\"parts/common.toml\"]\n");
  std::vector<RunPart> parts = {{"scenario", "s.toml", scenario.text}};
  EXPECT_FALSE(has_all_includes(parts));
  for (const IncludedText& include : scenario.includes) parts.push_back(include_part(include));
  EXPECT_EQ(parts[1].part, "include:parts/common.toml");
  EXPECT_EQ(parts[1].name, "common.toml");
  EXPECT_EQ(parts[2].part, "include:more.toml");
  EXPECT_TRUE(has_all_includes(parts));
  const Scenario again = parse_scenario(scenario.text, "run.lcm:s.toml", included_texts(parts));
  EXPECT_TRUE(again.is_initial_state_known);
  EXPECT_EQ(again.injections.size(), 1U);
  EXPECT_THAT(scenario_error(again, "fault", "target", "x", 0).what(),
              HasSubstr("run.lcm:s.toml:parts/common.toml:12:10: x"));
  parts.pop_back();
  EXPECT_FALSE(has_all_includes(parts));
  EXPECT_THROW(
      static_cast<void>(parse_scenario(scenario.text, "run.lcm:s.toml", included_texts(parts))),
      InputError);
  EXPECT_TRUE(has_all_includes({{"scenario", "s.toml", "include = [\n"}})) << "not TOML";
}

}  // namespace
}  // namespace faultline

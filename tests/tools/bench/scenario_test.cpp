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
  EXPECT_THAT(refusal(head + "\"gaussian\"\n"), HasSubstr("s.toml:9:8: "));
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
              HasSubstr("unknown key \"phase_rad\""));
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

}  // namespace
}  // namespace faultline

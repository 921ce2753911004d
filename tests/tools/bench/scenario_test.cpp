#include "tools/bench/scenario.h"

#include <fstream>

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

}  // namespace
}  // namespace faultline

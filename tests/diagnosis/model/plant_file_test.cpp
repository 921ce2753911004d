#include "diagnosis/model/plant_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/input_error.h"
#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

using ::testing::ElementsAre;
using ::testing::StartsWith;

std::string with(const std::string& from, const std::string& to) {
  std::string text = hou_plant_text();
  text.replace(text.find(from), from.size(), to);
  return text;
}

std::string refusal(const std::string& text) {
  try {
    static_cast<void>(parse_plant(text, "plant.toml"));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(PlantFile, ReadsHousPlant) {
  const PlantModel plant = hou_plant();
  EXPECT_EQ(plant.name, "hou2015");
  EXPECT_EQ(plant.time, TimeDomain::kContinuous);
  EXPECT_FALSE(plant.sample_time_s);
  EXPECT_EQ(plant.A(1, 2), 2.0);
  EXPECT_TRUE(plant.D.isZero(0.0));
  EXPECT_EQ(plant.D.cols(), 4);
  EXPECT_THAT(plant.fault_names(), ElementsAre("u1", "u2", "u3", "u4"));
  EXPECT_EQ(plant.faults[1].state, plant.B.col(1));
  EXPECT_EQ(plant.faults[1].kind, FaultKind::kActuator);
  EXPECT_EQ(plant.output_range, Eigen::Vector3d::Constant(100.0));
}

TEST(PlantFile, ReadsEveryKindOfEntry) {
  const PlantModel plant = parse_plant(R"(schema = 1
name = "all"
time = "discrete"
sample_time_s = 0.01
[states]
names = ["x1", "x2"]
units = ["m", "m/s"]
[inputs]
names = ["u1"]
units = ["N"]
range = [20]
[outputs]
names = ["y1", "y2"]
range = [5, 0.5]
[dynamics]
A = [[1, 0.1], [0, 1]]
B = [[0], [0.1]]
C = [[1, 0], [0, 1]]
D = [[0], [0.5]]
[faults]
actuators = ["u1"]
sensors = ["y2"]
[[fault]]
name = "leak"
state = [0, 1]
size = 0.5
[[disturbance]]
name = "d1"
output = [1, 0]
bound = 0.1
[[noise]]
output = [1, 0]
bound = 0.01
sigma = 0.003
[[nonlinearity]]
function = "sin"
gain = -0.333
E_o = [0, 1]
E_i = [1, 0]
slope = [-1, 1]
[operating_point]
x = [1, 2]
u = [3]
y = [4, 5]
)",
                                       "plant.toml");
  EXPECT_EQ(plant.sample_time_s, 0.01);
  EXPECT_THAT(plant.state_units, ElementsAre("m", "m/s"));
  EXPECT_TRUE(plant.output_units.empty());
  EXPECT_EQ(plant.input_range[0], 20.0);
  EXPECT_EQ(plant.output_range[1], 0.5);
  EXPECT_THAT(plant.fault_names(), ElementsAre("u1", "y2", "leak"));
  EXPECT_EQ(plant.faults[0].output, plant.D.col(0));
  EXPECT_EQ(plant.faults[1].kind, FaultKind::kSensor);
  EXPECT_EQ(plant.faults[1].output, Eigen::Vector2d::UnitY());
  EXPECT_TRUE(plant.faults[1].state.isZero(0.0));
  EXPECT_EQ(plant.faults[2].kind, FaultKind::kComponent);
  EXPECT_EQ(plant.faults[2].size, 0.5);
  EXPECT_TRUE(plant.faults[2].output.isZero(0.0));
  ASSERT_EQ(plant.disturbances.size(), 1u);
  EXPECT_EQ(plant.disturbances[0].bound, 0.1);
  ASSERT_EQ(plant.noises.size(), 1u);
  EXPECT_EQ(plant.noises[0].sigma, 0.003);
  ASSERT_EQ(plant.nonlinearities.size(), 1u);
  EXPECT_EQ(plant.nonlinearities[0].gain, -0.333);
  EXPECT_EQ(plant.nonlinearities[0].slope_min, -1.0);
  EXPECT_EQ(plant.x_operating[1], 2.0);
  EXPECT_EQ(plant.u_operating[0], 3.0);
  EXPECT_EQ(plant.y_operating[1], 5.0);
}

TEST(PlantFile, RefusesWrongNames) {
  EXPECT_EQ(refusal(with("\"x2\"", "\"x1\"")),
            "plant.toml:6:9: states.names: found \"x1\" twice, expected different names");
  EXPECT_EQ(refusal(with("[\"x1\", \"x2\", \"x3\"]", "[]")),
            "plant.toml:6:9: states.names: found no name, expected at least one");
  EXPECT_EQ(
      refusal(with("actuators = \"all\"", "actuators = [\"u1\", \"u9\"]")),
      "plant.toml:16:13: faults.actuators: found \"u9\", expected names of actuators; did you "
      "mean \"u1\"?");
  EXPECT_EQ(
      refusal(with("actuators = \"all\"", "actuators = \"some\"")),
      "plant.toml:16:13: faults.actuators: found \"some\", expected \"all\" or a list of names");
  EXPECT_EQ(
      refusal(hou_plant_text() + "[[fault]]\nname = \"u1\"\nstate = [1, 0, 0]\n"),
      "plant.toml:18:8: fault, entry 1.name: found \"u1\", expected a name no other fault has");
}

TEST(PlantFile, RefusesWrongShapes) {
  EXPECT_EQ(refusal(with("B = [[1, 0, 1, 1], [0, 1, 1, 0]", "B = [[1, 0, 1, 1], [0, 1, 1]")),
            "plant.toml:13:20: dynamics.B, row 2: found a list of 3 values, expected a list of 4 "
            "numbers");
  EXPECT_EQ(refusal(hou_plant_text() + "[operating_point]\nx = [1]\n"),
            "plant.toml:18:5: operating_point.x: found a list of 1 values, expected a list of 3 "
            "numbers");
}

TEST(PlantFile, RefusesWrongValues) {
  EXPECT_EQ(
      refusal(with("\"continuous\"", "\"hybrid\"")),
      "plant.toml:4:10: time: found \"hybrid\", expected one of \"continuous\", \"discrete\"");
  EXPECT_EQ(refusal(with("\"continuous\"", "\"discrete\"")),
            "plant.toml:1:1: sample_time_s: found nothing, expected a finite number");
  EXPECT_THAT(refusal(with("\"continuous\"", "\"continuous\"\nsample_time_s = 1")),
              StartsWith("plant.toml:5:17: sample_time_s: found it in a continuous plant"));
  EXPECT_EQ(refusal(with("[outputs]\n", "[outputs]\nrange = [1, 0, 1]\n")),
            "plant.toml:10:9: outputs.range: found 0, expected positive numbers");
  EXPECT_EQ(refusal(hou_plant_text() + "[[disturbance]]\nname = \"d\"\n"),
            "plant.toml:17:1: disturbance, entry 1: found no direction, expected a nonzero `state` "
            "or `output`");
  EXPECT_EQ(refusal(hou_plant_text() + "[[noise]]\noutput = [1, 0, 0]\n"),
            "plant.toml:17:1: noise, entry 1: found neither, expected `bound` or `sigma`");
}

TEST(PlantFile, NamesNoiseSourcesByTheirPlaceUnlessItIsTold) {
  const std::string source = "[[noise]]\noutput = [1, 0, 0]\nbound = 0.1\n";
  const PlantModel plant =
      parse_plant(hou_plant_text() + source + source + "name = \"hum\"\n" + source, "plant.toml");
  ASSERT_EQ(plant.noises.size(), 3u);
  EXPECT_EQ(plant.noises[0].name, "noise1");
  EXPECT_EQ(plant.noises[1].name, "hum");
  EXPECT_EQ(plant.noises[2].name, "noise3");
  EXPECT_EQ(refusal(hou_plant_text() + source + source + "name = \"noise1\"\n"),
            "plant.toml:23:8: noise, entry 2.name: found \"noise1\", expected a name no other "
            "noise source has");
  EXPECT_THAT(refusal(hou_plant_text() + source + "name = \"\"\n"),
              StartsWith("plant.toml:20:8: noise, entry 1.name: found \"\""));
}

TEST(PlantFile, RefusesTheNameByWhichScenariosMeanEverySource) {
  EXPECT_EQ(refusal(hou_plant_text() + "[[disturbance]]\nname = \"all\"\nstate = [1, 0, 0]\n"),
            "plant.toml:18:8: disturbance, entry 1.name: found \"all\", expected another name: "
            "scenarios mean every disturbance by it");
  EXPECT_THAT(refusal(hou_plant_text() + "[[noise]]\nname = \"all\"\noutput = [1, 0, 0]\n"),
              StartsWith("plant.toml:18:8: noise, entry 1.name: found \"all\""));
}

TEST(PlantFile, ReadsHowFarTheStatesGo) {
  EXPECT_FALSE(hou_plant().state_range);
  const std::string states = "names = [\"x1\", \"x2\", \"x3\"]\n";
  const PlantModel plant = parse_plant(with(states, states + "range = [1, 2, 3]\n"), "plant.toml");
  ASSERT_TRUE(plant.state_range);
  EXPECT_EQ(*plant.state_range, Eigen::Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(refusal(with(states, states + "range = [1, 0, 3]\n")),
            "plant.toml:7:9: states.range: found 0, expected positive numbers");
  EXPECT_THAT(refusal(with(states, states + "range = [1, 2]\n")),
              StartsWith("plant.toml:7:9: states.range: found a list of 2 values"));
}

TEST(PlantFile, RefusesUnknownKeys) {
  EXPECT_EQ(refusal(with("actuators", "actuator")),
            "plant.toml:16:1: faults: found unknown key \"actuator\"; did you mean \"actuators\"?");
}

}  // namespace
}  // namespace faultline

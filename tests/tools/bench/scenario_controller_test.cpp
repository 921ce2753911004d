// [controller] and [[reference]] of a scenario: read, checked against the plant, worked out.
#include <complex>
#include <filesystem>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/input_error.h"
#include "diagnosis/model/plant_file.h"
#include "tools/bench/bench.h"
#include "tools/bench/controller_plan.h"

namespace faultline {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const std::filesystem::path kExamples = FAULTLINE_EXAMPLES_DIR;
constexpr double kSampleTime_s = 0.01;

constexpr char kHead[] = R"(schema = 1
name = "s"
plant = "plant.toml"
bank = "bank.toml"
dbc = "bench.dbc"
duration_s = 10.0
)";

Scenario scenario_of(const std::string& rest) { return parse_scenario(kHead + rest, "s.toml"); }

/// Of the flexible joint (4 states, 1 input, outputs y1, y2, y3), or of another example's plant.
ControllerPlan plan(const std::string& rest, const char* example = "ma2024") {
  return plan_controller(scenario_of(rest), read_plant(kExamples / example / "plant.toml"),
                         kSampleTime_s, std::nullopt);
}

std::string refusal(const std::string& rest, const char* example = "ma2024") {
  try {
    static_cast<void>(plan(rest, example));
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

std::string controller(const std::string& rest) { return "[controller]\n" + rest; }
const std::string kObserver = controller("kind = \"observer\"\n");

TEST(ScenarioController, ReadsAnObserverWithAllThatItTakes) {
  const ControllerSpec spec = scenario_of(R"([controller]
kind = "observer"
K = [[1, 2, 3, 4]]
R_v = [[1]]
feedforward = [0.5]
amplitude = [1]
frequency_Hz = [2]
reference = {y1 = 0.25}
limits = {u1 = [-1, 2]}
[[reference]]
output = "y1"
at_s = 1
value = 0.5
ramp_s = 2
)")
                                  .controller;
  EXPECT_EQ(spec.kind, ControllerKind::kObserver);
  EXPECT_EQ((*spec.K)(0, 3), 4.0);
  EXPECT_FALSE(spec.L);
  EXPECT_EQ((*spec.R_v)(0, 0), 1.0);
  EXPECT_EQ(spec.reference.at("y1"), 0.25);
  EXPECT_EQ(spec.limits.at("u1"), Eigen::Vector2d(-1.0, 2.0));
  ASSERT_EQ(spec.reference_steps.size(), 1U);
  EXPECT_EQ(spec.reference_steps[0].output, "y1");
  EXPECT_EQ(spec.reference_steps[0].step.at_s, 1.0);
  EXPECT_EQ(spec.reference_steps[0].step.value, 0.5);
  EXPECT_EQ(spec.reference_steps[0].step.ramp_s, 2.0);
}

TEST(ScenarioController, ReadsPidLoops) {
  const ControllerSpec spec = scenario_of(R"([controller]
kind = "pid"
[[controller.loop]]
output = "y1"
input = "u1"
K_p = -2
T_i_s = 3
T_d_s = 0.5
N = 8
anti_windup = "clamping"
[[controller.loop]]
output = "y2"
input = "u2"
K_p = 1
T_i_s = 4
T_t_s = 2
)")
                                  .controller;
  ASSERT_EQ(spec.loops.size(), 2U);
  EXPECT_EQ(spec.loops[0].output, "y1");
  EXPECT_EQ(spec.loops[0].loop.K_p, -2.0);
  EXPECT_EQ(spec.loops[0].loop.T_i_s, 3.0);
  EXPECT_EQ(spec.loops[0].loop.T_d_s, 0.5);
  EXPECT_EQ(spec.loops[0].loop.N, 8.0);
  EXPECT_EQ(spec.loops[0].loop.anti_windup, AntiWindup::kClamping);
  EXPECT_EQ(spec.loops[1].loop.anti_windup, AntiWindup::kBackCalculation);
  EXPECT_EQ(spec.loops[1].loop.T_t_s, 2.0);
}

TEST(ScenarioController, RefusesKeysThatItsKindDoesNotHave) {
  EXPECT_THAT(refusal(controller("kind = \"none\"\nreference = {y1 = 1}\n")),
              HasSubstr("unknown key \"reference\""));
  EXPECT_THAT(refusal(controller("kind = \"external\"\nfeedforward = [1]\n")),
              HasSubstr("unknown key \"feedforward\""));
  EXPECT_THAT(refusal(controller("kind = \"gain\"\nK = [[1]]\nQ = [[1]]\n")),
              HasSubstr("unknown key \"Q\""));
  EXPECT_THAT(refusal(kObserver + "L = [[1]]\nQ_w = [[1]]\n"),
              AllOf(HasSubstr("s.toml:10:"), HasSubstr("found Q_w beside L")));
  EXPECT_THAT(refusal(kObserver + "K = [[1]]\nR = [[1]]\n"), HasSubstr("found R beside K"));
  const std::string loop = "[[controller.loop]]\noutput = \"y1\"\ninput = \"u1\"\nK_p = 1\n";
  EXPECT_THAT(refusal(controller("kind = \"pid\"\n") + loop + "N = 4\n"),
              HasSubstr("unknown key \"N\""));
  EXPECT_THAT(refusal(controller("kind = \"pid\"\n") + loop + "T_t_s = 4\n"),
              HasSubstr("unknown key \"T_t_s\""));
  EXPECT_THAT(refusal(controller("kind = \"none\"\n") +
                      "[[reference]]\noutput = \"y1\"\nat_s = 1\nvalue = 1\n"),
              AllOf(HasSubstr("kind \"none\""), HasSubstr("expected one of kind lqr")));
}

TEST(ScenarioController, PointsAtWhatIsWrong) {
  EXPECT_THAT(refusal(controller("kind = \"pid\"\n")), HasSubstr("expected [[controller.loop]]"));
  EXPECT_THAT(refusal(kObserver + "limits = {u1 = [1, 1]}\n"),
              HasSubstr("found [1, 1], expected [smallest, largest]"));
  EXPECT_THAT(refusal(kObserver + "limits = {u2 = [0, 1]}\n"),
              AllOf(HasSubstr("s.toml:9:"), HasSubstr("found \"u2\", expected an input"),
                    HasSubstr("did you mean \"u1\"?")));
  EXPECT_THAT(refusal(kObserver + "reference = {y9 = 1}\n"),
              AllOf(HasSubstr("s.toml:9:"), HasSubstr("found \"y9\", expected an output")));
  EXPECT_THAT(refusal(kObserver + "K = [[1, 2, 3]]\n"),
              AllOf(HasSubstr("s.toml:9:"), HasSubstr("controller.K: found 1×3, expected 1×4")));
  EXPECT_THAT(refusal(kObserver + "L = [[1, 2, 3]]\n"), HasSubstr("found 1×3, expected 4×3"));
  EXPECT_THAT(refusal(kObserver + "Q_w = [[1]]\n"), HasSubstr("found 1×1, expected 4×4"));
  EXPECT_THAT(refusal(kObserver + "R_v = [[1]]\n"), HasSubstr("found 1×1, expected 3×3"));
  EXPECT_THAT(refusal(controller("kind = \"mpc\"\n")), HasSubstr("s.toml:8:"));
  const std::string step = "[[reference]]\nat_s = 2\nvalue = 1\noutput = ";
  EXPECT_THAT(refusal(kObserver + step + "\"y4\"\n"),
              AllOf(HasSubstr("s.toml:12:"), HasSubstr("found \"y4\"")));
  EXPECT_THAT(refusal(kObserver + step + "\"y1\"\n" + step + "\"y1\"\n"),
              AllOf(HasSubstr("s.toml:14:"), HasSubstr("found 2 s for \"y1\" after 2 s")));
  EXPECT_THAT(refusal(controller("kind = \"pid\"\n[[controller.loop]]\noutput = \"y1\"\n"
                                 "input = \"u1\"\nK_p = 0\n")),
              HasSubstr("found 0, expected a gain that acts"));
}

TEST(ScenarioController, RefusesTwoLoopsOnOneInput) {
  const std::string loop = "[[controller.loop]]\noutput = \"y1\"\ninput = \"u1\"\nK_p = 1\n";
  EXPECT_THAT(refusal(controller("kind = \"pid\"\n") + loop + loop),
              HasSubstr("found two loops that move input \"u1\""));
}

TEST(ScenarioController, RefusesAReferenceThatThePlantCannotHold) {
  // The motor's angle cannot stand still while its speed is 1 rad/s.
  EXPECT_THAT(refusal(kObserver + "reference = {y1 = 0.5, y2 = 1}\n"),
              AllOf(HasSubstr("s.toml:9:"), HasSubstr("cannot hold"), HasSubstr("at 0 s")));
  EXPECT_THAT(refusal(kObserver + "reference = {y1 = 0.5, y2 = 0}\n"
                                  "[[reference]]\noutput = \"y2\"\nat_s = 3\nvalue = 1\n"),
              AllOf(HasSubstr("cannot hold"), HasSubstr("at 3 s")));
  EXPECT_EQ(refusal(kObserver + "reference = {y1 = 0.5, y2 = 0}\n"), "accepted");
}

TEST(ScenarioController, SaysWhichModeTheOutputsDoNotShow) {
  PlantModel plant = read_plant(kExamples / "ma2024" / "plant.toml");
  plant.nonlinearities.clear();  // without gravity the joint may rest anywhere: a mode at 1
  plant.C = Eigen::MatrixXd::Zero(3, 4);
  plant.C.col(1).setOnes();  // speed alone
  try {
    static_cast<void>(plan_controller(scenario_of(kObserver), plant, kSampleTime_s, std::nullopt));
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("controller: found the mode at 1 per sample"),
                                    HasSubstr("no output shows")));
  }
}

TEST(ScenarioController, PlansAnObserverWhosePolesAreThoseOfItsParts) {
  const ControllerPlan joint = plan(kObserver);
  EXPECT_EQ(joint.K.rows(), 1);
  EXPECT_EQ(joint.L.cols(), 3);
  ASSERT_EQ(joint.observer_poles.size(), 4U);
  EXPECT_LT(std::abs(joint.observer_poles.front()), 1.0);
  EXPECT_LT(std::abs(joint.closed_loop_poles.front()), 1.0);
  EXPECT_TRUE(joint.warnings.empty());
}

TEST(ScenarioController, WarnsOfALoopThatDoesNotComeToRest) {
  const ControllerPlan weak = plan(
      controller("kind = \"gain\"\nK = [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]\n"), "hou2015");
  ASSERT_EQ(weak.warnings.size(), 1U);
  EXPECT_THAT(weak.warnings[0], HasSubstr("pole of size 1.01639"));  // exp(1.6262 * 0.01)
  EXPECT_TRUE(plan(controller("kind = \"lqr\"\n"), "hou2015").warnings.empty());
  EXPECT_TRUE(plan(controller("kind = \"none\"\n"), "hou2015").warnings.empty());
}

TEST(ScenarioController, ExternalMakesNone) {
  EXPECT_EQ(plan(controller("kind = \"external\"\n")).make(), nullptr);
}

TEST(RunBench, RefusesTheLoopBusWithAnExternalController) {
  BenchInputs inputs;
  inputs.scenario = scenario_of(controller("kind = \"external\"\n"));
  BenchOptions options;
  options.bus = "loop";
  try {
    static_cast<void>(run_bench(inputs, options));
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("found \"loop\""), HasSubstr("can:vcan0")));
  }
}

/// Of the flexible joint by a record.
ControllerPlan plan_record(const std::string& csv, const std::string& rest = "") {
  return plan_controller(
      scenario_of(controller("kind = \"recorded\"\nfile = \"torque.csv\"\n" + rest)),
      read_plant(kExamples / "ma2024" / "plant.toml"), kSampleTime_s, NamedText{csv, "torque.csv"});
}

TEST(ScenarioController, TakesCommandsFromARecord) {
  const ControllerPlan recorded = plan_record("t_s,u1\n0,1\n0.01,2\n10,3\n");
  EXPECT_TRUE(recorded.warnings.empty());
  double u = 0.0;
  const auto commands = recorded.make();
  commands->command(1, {}, {&u, 1});
  EXPECT_EQ(u, 2.0);
  commands->command(1000, {}, {&u, 1});
  EXPECT_EQ(u, 3.0);
}

TEST(ScenarioController, SaysWhatIsWrongWithARecord) {
  const auto refusal = [](const std::string& csv) -> std::string {
    try {
      static_cast<void>(plan_record(csv));
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_THAT(refusal("t_s,u2\n0,1\n1,2\n"),
              AllOf(HasSubstr("torque.csv:1:1: "), HasSubstr("found column \"u2\""),
                    HasSubstr("did you mean \"u1\"?")));
  EXPECT_THAT(refusal("t_s,u1\n0,1\n1,x\n"), HasSubstr("torque.csv:3"));
  const ControllerPlan brief = plan_record("t_s,u1\n0,1\n4,2\n");
  ASSERT_EQ(brief.warnings.size(), 1U);
  EXPECT_THAT(brief.warnings[0], HasSubstr("torque.csv ends after 4 s, expected 10 s"));
}

TEST(ScenarioController, SaysThatARecordIsNotThere) {
  const Scenario scenario =
      scenario_of(controller("kind = \"recorded\"\nfile = \"nowhere.csv\"\n"));
  try {
    static_cast<void>(read_commands(scenario));
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(),
                AllOf(HasSubstr("s.toml:9:"), HasSubstr("found no file nowhere.csv")));
  }
}

TEST(Examples, AreControlledAndTheirFaultIsNamed) {
  for (const char* example :
       {"ma2024/output_feedback.toml", "ma2024/recorded.toml", "three_tank/pid.toml"}) {
    SCOPED_TRACE(example);
    const BenchInputs inputs = load_bench_inputs(kExamples / example);
    EXPECT_TRUE(inputs.warnings.empty());
    BenchOptions options;
    options.bus = "loop";
    const BenchResult result = run_bench(inputs, options);
    EXPECT_FALSE(result.stop_reason);
    EXPECT_TRUE(result.history.are_expectations_met());
  }
}

TEST(Examples, CarryTheirRecordInTheirParts) {
  const BenchInputs inputs = load_bench_inputs(kExamples / "ma2024" / "recorded.toml");
  const RunPart* record = find_part(inputs.parts, "commands");
  ASSERT_NE(record, nullptr);
  const BenchInputs again = bench_inputs_of_parts(inputs.parts, "run.lcm");
  double u = 0.0, u_again = 0.0;
  inputs.make_controller()->command(700, {}, {&u, 1});
  again.make_controller()->command(700, {}, {&u_again, 1});
  EXPECT_NE(u, 0.0);
  EXPECT_EQ(u_again, u);
}

}  // namespace
}  // namespace faultline

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include <faultline/event_t.hpp>
#include <faultline/truth_t.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/input_error.h"
#include "diagnosis/model/plant_file.h"
#include "sim/static_feedback.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"
#include "tools/bench/run_summary.h"
#include "tools/lcm/channels.h"

namespace faultline {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr std::size_t kSamples = 501;

// Ten lines: what is added to it begins in line 11.
constexpr char kScenario[] = R"(schema = 1
name   = "nonlinear"
plant  = "plant.toml"
bank   = "hou.bank.json"
dbc    = "bench.dbc"
duration_s = 5.0
seed   = 1
[controller]
kind = "lqr"
feedforward = [1.0, 1.0, 1.0, 1.0]
)";

constexpr char kPerturbed[] = R"([[disturbance]]
target = "wind"
kind = "uniform"
[[noise]]
target = "all"
kind = "uniform"
)";

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// The plant of Hou with friction, wind and a noisy sensor, and the bank of the plant without them,
/// as files.
class NonlinearRunTest : public testing::Test {
 protected:
  NonlinearRunTest() {
    const std::filesystem::path hou = std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015";
    std::filesystem::copy_file(hou / "bench.dbc", path("bench.dbc"));
    std::ofstream(path("plant.toml")) << text_of(hou / "plant.toml") << R"(
[[disturbance]]
name  = "wind"
state = [0, 1, 0]
bound = 0.05
[[noise]]
output = [0, 0, 1]
bound  = 0.02
[[nonlinearity]]
function = "atan"
gain = -1.5
E_o  = [0, 0, 1]
E_i  = [1, 0, 0.5]
)";
    Bank bank = load_bench_inputs(hou / "demo.toml").bank;
    bank.plant_digest = plant_digest(read_plant(path("plant.toml")));
    write_bank(bank, path("hou.bank.json"));
  }

  [[nodiscard]] std::filesystem::path path(const std::string& name) const {
    return folder_.path() / name;
  }
  BenchInputs load(const std::string& rest) {
    std::ofstream(path("s.toml")) << kScenario << rest;
    return load_bench_inputs(path("s.toml"));
  }
  BenchResult run(const BenchInputs& inputs, const std::string& log) {
    BenchOptions options;
    options.bus = "loop";
    options.log = path(log);
    return run_bench(inputs, options);
  }
  std::string refusal(const std::string& rest) {
    try {
      static_cast<void>(load(rest));
    } catch (const InputError& error) {
      const std::string text = error.what();
      return text.substr(text.rfind("/", text.find(".toml:")) + 1);
    }
    return "accepted";
  }
  TemporaryFolder folder_;
};

TEST_F(NonlinearRunTest, GivesTheSameBitsEachTimeAndOthersWithAnotherSeed) {
  BenchInputs inputs = load(kPerturbed);
  const BenchResult result = run(inputs, "a.lcm");
  EXPECT_FALSE(result.stop_reason);
  EXPECT_EQ(result.counters.clamped_values, 0U);
  run(inputs, "b.lcm");
  const auto a = logged_residuals(path("a.lcm"));
  ASSERT_EQ(a.size(), kSamples);
  EXPECT_EQ(first_difference(a, logged_residuals(path("b.lcm"))), kSamples);
  std::string other = kScenario;
  other.replace(other.find("seed   = 1"), 10, "seed   = 2");
  std::ofstream(path("other.toml")) << other << kPerturbed;
  run(load_bench_inputs(path("other.toml")), "c.lcm");
  EXPECT_LT(first_difference(a, logged_residuals(path("c.lcm"))), 3U);
}

// The simulator of another method is another plant: by its error, not by more.
TEST_F(NonlinearRunTest, StepsByTheMethodOfTheScenario) {
  const auto final_state = [&](const std::string& simulation, const std::string& log) {
    run(load(simulation), log);
    return logged_messages<truth_t>(path(log), kTruthChannel).back().x;
  };
  const auto distance = [](const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
    return std::sqrt(sum);
  };
  const auto usual = final_state("", "usual.lcm");
  const auto rk4 = final_state("[simulation]\nmethod = \"rk4\"\nsubsteps = 10\n", "rk4.lcm");
  const auto fine = final_state("[simulation]\nmethod = \"rk4\"\nsubsteps = 100\n", "fine.lcm");
  const auto zoh = final_state("[simulation]\nmethod = \"zoh\"\n", "zoh.lcm");
  const auto euler = final_state("[simulation]\nmethod = \"euler\"\n", "euler.lcm");
  EXPECT_EQ(usual, rk4);
  EXPECT_LT(distance(rk4, fine), 1e-6);
  EXPECT_GT(distance(rk4, fine), 0.0);
  EXPECT_GT(distance(zoh, fine), 1e-8);
  EXPECT_LT(distance(zoh, fine), 0.1);
  EXPECT_GT(distance(euler, fine), 1e-8);
  EXPECT_NE(euler, zoh);
}

TEST_F(NonlinearRunTest, TellsWhatASinusoidAddsInEveryCycle) {
  const std::string faults = R"([[fault]]
target = "u1"
kind = "bias"
value = 0.2
at_s = 1.0
[[fault]]
target = "u1"
kind = "sinusoid"
value = 0.1
frequency_Hz = 5
at_s = 1.0
until_s = 2.0
)";
  run(load(faults), "run.lcm");
  int told = 0;
  for (const truth_t& truth : logged_messages<truth_t>(path("run.lcm"), kTruthChannel)) {
    EXPECT_EQ(truth.fault_count, truth.cycle < 100 ? 0 : truth.cycle < 200 ? 2 : 1);
    if (truth.cycle < 100 || truth.cycle >= 200) continue;
    ++told;
    ASSERT_EQ(truth.faults.size(), 2U);
    EXPECT_EQ(truth.faults[1].kind, "sinusoid");
    EXPECT_NEAR(truth.faults[1].value,
                0.1 * std::sin(0.1 * std::numbers::pi * static_cast<double>(truth.cycle - 100)),
                1e-13);
  }
  EXPECT_EQ(told, 100);
}

std::string summary_text(const BenchInputs& inputs, const BenchResult& result) {
  BenchOptions options;
  options.bus = "loop";
  std::FILE* file = std::tmpfile();
  print_summary(file, inputs, options, result);
  std::string text(static_cast<std::size_t>(std::ftell(file)), '\0');
  std::rewind(file);
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  return text;
}

TEST_F(NonlinearRunTest, WarnsOfNoiseBeyondTheBoundOfThePlantFile) {
  const BenchInputs within = load(kPerturbed);
  EXPECT_THAT(summary_text(within, run(within, "within.lcm")), Not(HasSubstr("WARNING")));
  const BenchInputs beyond =
      load("[[noise]]\ntarget = \"noise1\"\nkind = \"sinusoid\"\nsize = 0.03\nfrequency_Hz = 1\n");
  const std::string text = summary_text(beyond, run(beyond, "beyond.lcm"));
  EXPECT_THAT(text, HasSubstr("WARNING  noise \"noise1\" may reach 0.03, beyond its bound 0.02"));
  std::vector<std::string> warnings;
  for (const event_t& event : logged_messages<event_t>(path("beyond.lcm"), kEventChannel)) {
    if (event.severity == "warning") warnings.push_back(event.text);
  }
  EXPECT_THAT(warnings, testing::ElementsAre(HasSubstr("beyond its bound 0.02")));
}

TEST_F(NonlinearRunTest, StopsWhenThePlantDiverges) {
  BenchInputs inputs = load("");
  inputs.make_controller = [&inputs] {
    return std::make_unique<StaticFeedback>(
        open_loop(inputs.plant, Eigen::VectorXd::Ones(inputs.plant.m())));
  };
  inputs.scenario.duration_s = 1e4;
  const BenchResult result = run(inputs, "run.lcm");
  ASSERT_TRUE(result.stop_reason);
  EXPECT_EQ(result.stop_reason->kind, StopReason::Kind::kPlant);
}

TEST_F(NonlinearRunTest, RefusesAMethodThatThePlantCannotBeSteppedBy) {
  EXPECT_EQ(refusal("[simulation]\nmethod = \"exact\"\n"),
            "s.toml:12:10: simulation.method: found \"exact\", expected \"zoh\", \"euler\" or "
            "\"rk4\": plant \"hou2015\" is nonlinear and in continuous time");
}

TEST_F(NonlinearRunTest, PointsAtDisturbancesAndNoiseThatThePlantDoesNotHave) {
  EXPECT_EQ(refusal("[[disturbance]]\ntarget = \"wimd\"\nkind = \"uniform\"\n"),
            "s.toml:12:10: disturbance, entry 1.target: found \"wimd\", expected \"all\" or a "
            "[[disturbance]] of plant \"hou2015\" (wind); did you mean \"wind\"?");
  EXPECT_THAT(refusal("[[noise]]\ntarget = \"all\"\nkind = \"uniform\"\n[[noise]]\n"
                      "target = \"wind\"\nkind = \"uniform\"\n"),
              testing::StartsWith("s.toml:15:10: noise, entry 2.target: found \"wind\""));
}

}  // namespace
}  // namespace faultline

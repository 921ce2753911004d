// The figures of Hou et al. 2015 on the bench, against tests/golden/geometric/hou_simulation.json.
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"

namespace faultline {
namespace {

const std::filesystem::path kExamples = std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015";

/// Scenario file → entry of the golden file.
const std::map<std::string, std::string> kGoldenOf = {
    {"fig05", "fig5_none"},
    {"fig06", "fig6_weak_m1=0.4"},
    {"fig07", "fig7_abrupt_1_m=2"},
    {"fig08", "fig8_abrupt_2_m=2"},
    {"fig09", "fig9_abrupt_3_m=2"},
    {"fig10", "fig10_abrupt_4_m=2"},
    {"fig11", "fig11_gain_1_second_step(2->4)"},
    {"fig12", "fig12_gain_3_second_step(2->4)"},
    {"fig13", "fig13_2+3_m=2"},
    {"fig14", "fig14_2+3_gain"},
    {"fig15", "fig15_1@50_3@70"},
    {"fig16", "fig16_4@50_2@70"},
    {"marginal_1", "marginal_1_m=1"},
    {"marginal_2", "marginal_2_m=0.6"},
    {"gain_1", "gain_1_multiplicative_gamma0.5_v0=10"},
    {"gain_3", "gain_3_multiplicative_gamma0.5_v0=10"}};

const nlohmann::json& golden() {
  static const nlohmann::json json = [] {
    std::ifstream in(std::filesystem::path(FAULTLINE_GOLDEN_DIR) / "geometric/hou_simulation.json");
    return nlohmann::json::parse(in);
  }();
  return json;
}

class Hou2015 : public testing::TestWithParam<std::pair<const std::string, std::string>> {};

TEST_P(Hou2015, MeetsItsExpectationsAndTheOraclesFirstCrossings) {
  const auto& [name, key] = GetParam();
  const BenchInputs inputs = load_bench_inputs(kExamples / (name + ".toml"));
  const TemporaryFolder folder;
  BenchOptions options;
  options.bus = "loop";
  options.log = folder.path() / "run.lcm";
  const BenchResult result = run_bench(inputs, options);

  EXPECT_TRUE(result.history.are_expectations_met());
  EXPECT_EQ(result.counters.samples, 10001U);
  EXPECT_EQ(result.counters.bad_samples, 0U);
  EXPECT_EQ(result.counters.late_cycles, 0U);
  EXPECT_EQ(result.counters.frames_sent, 5U * 10001U);
  EXPECT_EQ(result.counters.frames_received, result.counters.frames_sent);
  EXPECT_EQ(result.counters.clamped_values, 0U);

  const nlohmann::json& expected = golden().at(key).at("residuals");
  const std::vector<LoggedResidual> logged = logged_residuals(*options.log);
  ASSERT_EQ(logged.size(), 10001U);
  ASSERT_EQ(expected.size(), inputs.bank.filters.size());
  for (std::size_t i = 0; i < inputs.bank.filters.size(); ++i) {
    const std::string& residual = inputs.bank.filters[i].name;
    SCOPED_TRACE(residual);
    const nlohmann::json& of_golden = expected.at(residual);
    const std::optional<double>& first_s = result.history.first_fired_s()[i];
    ASSERT_EQ(first_s.has_value(), !of_golden.at("first_cross").is_null());
    if (first_s) {
      EXPECT_NEAR(*first_s, of_golden.at("first_cross").get<double>(),
                  inputs.bank.sample_time_s + 1e-9);
    }
    // What 24-bit sensors of resolution 1e-4 leave of accuracy: half an LSB on each of three
    // outputs through gains of at most 3 (|H|, and |E| over the pole) gives 5e-4.
    EXPECT_NEAR(std::abs(logged.back().residual[i]),
                std::abs(of_golden.at("r_final").get<double>()), 5e-4);
    EXPECT_NEAR(std::abs(logged[6999].residual[i]), std::abs(of_golden.at("r69_99").get<double>()),
                5e-4);
  }
}

INSTANTIATE_TEST_SUITE_P(Figures, Hou2015, testing::ValuesIn(kGoldenOf.begin(), kGoldenOf.end()),
                         [](const auto& figure) { return figure.param.first; });

TEST(Hou2015Examples, HasAScenarioForEveryFileHere) {
  for (const auto& entry : std::filesystem::directory_iterator(kExamples)) {
    const std::string name = entry.path().stem().string();
    if (!entry.is_regular_file() || entry.path().extension() != ".toml") {
      continue;  // the folder and the script of the figures page
    }
    if (name.starts_with("fig") || name.starts_with("marginal") || name.starts_with("gain")) {
      EXPECT_TRUE(kGoldenOf.contains(name)) << name;
    }
  }
}

}  // namespace
}  // namespace faultline

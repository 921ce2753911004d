// The example folders of the plants in C++: every scenario answers what it says it does.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "faultline/residual_t.hpp"
#include <gtest/gtest.h>

#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"

namespace faultline {
namespace {

// Every scenario of a folder but the plant and its banks.
std::vector<std::filesystem::path> scenarios(const std::string& folder) {
  std::vector<std::filesystem::path> found;
  for (const auto& entry : std::filesystem::directory_iterator(
           std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / folder)) {
    const std::string name = entry.path().stem();
    if (entry.path().extension() == ".toml" && name != "plant" && !name.starts_with("bank")) {
      found.push_back(entry.path());
    }
  }
  std::sort(found.begin(), found.end());
  return found;
}

class PlantExample : public testing::TestWithParam<std::string> {};

TEST_P(PlantExample, EveryScenarioMeetsItsExpectations) {
  const std::vector<std::filesystem::path> files = scenarios(GetParam());
  ASSERT_GE(files.size(), 8U);
  std::set<Verdict> expected;
  for (const std::filesystem::path& file : files) {
    SCOPED_TRACE(file);
    const BenchInputs inputs = load_bench_inputs(file);
    BenchOptions options;
    options.bus = "loop";
    const BenchResult result = run_bench(inputs, options);
    EXPECT_FALSE(inputs.scenario.expectations.empty());
    EXPECT_TRUE(result.history.are_expectations_met());
    EXPECT_EQ(result.counters.bad_samples, 0U);
    EXPECT_EQ(result.counters.clamped_values, 0U);
    for (const Expectation& expectation : inputs.scenario.expectations) {
      expected.insert(expectation.verdicts.begin(), expectation.verdicts.end());
    }
  }
  for (const Verdict verdict :
       {Verdict::kHealthy, Verdict::kIsolated, Verdict::kAmbiguous, Verdict::kUnexplained}) {
    // Eight thrust directions, none twice: nothing on the vessel looks like anything else.
    if (verdict == Verdict::kAmbiguous && GetParam() == "azimuth_vessel") continue;
    EXPECT_TRUE(expected.contains(verdict)) << verdict_name(verdict);
  }
}

TEST_P(PlantExample, StaysBelowItsThresholdsForTenHealthyMinutes) {
  // What is left to noise and disturbances that are drawn otherwise.
  constexpr double kReserve = 0.1;
  const BenchInputs inputs = load_bench_inputs(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) /
                                               GetParam() / "healthy.toml");
  EXPECT_EQ(inputs.scenario.duration_s, 600.0);
  EXPECT_FALSE(inputs.scenario.disturbances.empty());
  const TemporaryFolder folder;
  BenchOptions options;
  options.bus = "loop";
  options.log = folder.path() / "run.lcm";
  const BenchResult result = run_bench(inputs, options);
  EXPECT_TRUE(result.history.are_expectations_met());
  const auto begin = static_cast<std::size_t>(
      std::ceil(inputs.scenario.expectations.front().from_s / inputs.bank.sample_time_s));
  const auto residuals = logged_messages<residual_t>(*options.log, "FAULTLINE_RESIDUAL");
  ASSERT_GT(residuals.size(), begin);
  double worst = 0.0;
  for (std::size_t k = begin; k < residuals.size(); ++k) {
    for (std::size_t i = 0; i < residuals[k].evaluation.size(); ++i) {
      worst = std::max(worst, residuals[k].evaluation[i] / residuals[k].threshold[i]);
    }
  }
  EXPECT_LT(worst, 1.0 - kReserve);
  EXPECT_GT(worst, 0.1);  // else the threshold is too far from what the plant does
}

INSTANTIATE_TEST_SUITE_P(Folders, PlantExample,
                         testing::Values("three_tank", "azimuth_vessel", "electric_car"),
                         [](const auto& folder) { return folder.param; });

}  // namespace
}  // namespace faultline

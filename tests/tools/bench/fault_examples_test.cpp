// The scenarios in examples/*/faults: every way in which an actuator or a sensor can fail, and what
// the diagnosis says to it.
#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "sim/fault.h"
#include "tools/bench/bench.h"
#include "tools/bench/expectation.h"
#include "tools/bench/run_history.h"

namespace faultline {
namespace {

/// "hou2015/bias", ..
std::vector<std::string> fault_examples() {
  std::vector<std::string> names;
  for (const char* plant : {"hou2015", "ma2024"}) {
    const auto folder = std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / plant / "faults";
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
      if (entry.path().extension() != ".toml") continue;
      names.push_back(plant + std::string("/") + entry.path().stem().string());
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

std::filesystem::path file_of(const std::string& name) {
  const std::filesystem::path plant_and_stem(name);
  return std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / plant_and_stem.parent_path() / "faults" /
         (plant_and_stem.stem().string() + ".toml");
}

class FaultExamples : public testing::TestWithParam<std::string> {};

TEST_P(FaultExamples, AreDiagnosedAsTheySay) {
  const BenchInputs inputs = load_bench_inputs(file_of(GetParam()));
  BenchOptions options;
  options.bus = "loop";
  const BenchResult result = run_bench(inputs, options);
  EXPECT_FALSE(result.stop_reason.has_value());
  for (const ExpectationOutcome& outcome : result.history.expectations()) {
    EXPECT_TRUE(outcome.is_met) << expectation_words(outcome.expectation);
  }
}

std::string test_name(const testing::TestParamInfo<std::string>& example) {
  std::string words = example.param;
  std::replace(words.begin(), words.end(), '/', '_');
  return words;
}

INSTANTIATE_TEST_SUITE_P(All, FaultExamples, testing::ValuesIn(fault_examples()), test_name);

TEST(FaultExampleFolders, ShowEveryKindOfThePlantLevel) {
  std::set<InjectionKind> shown;
  for (const std::string& name : fault_examples()) {
    const Scenario scenario = read_scenario(file_of(name));
    EXPECT_FALSE(scenario.expectations.empty()) << name;
    for (const Injection& injection : scenario.injections) shown.insert(injection.kind);
  }
  for (const InjectionKind kind : all_injection_kinds()) {
    if (level_of(kind) != FaultLevel::kPlant) continue;
    EXPECT_TRUE(shown.contains(kind)) << injection_kind_name(kind);
  }
}

}  // namespace
}  // namespace faultline

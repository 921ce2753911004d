// Every value of a bank file replaced by values that do not belong there: the file is refused with
// its place, or what it says can be run.

#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/estimating_filters.h"
#include "diagnosis/runtime/estimator.h"
#include "diagnosis/runtime/evaluator.h"
#include "diagnosis/runtime/residual_bank.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/diagnosis/observer_bank.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

/// Runs three samples of a bank that was read, in all that takes one.
void run(const Bank& bank) {
  ResidualBank filters(bank);
  Evaluator evaluator(bank);
  const DecisionTable table(bank);
  EstimatingFilters estimates(bank);
  MagnitudeEstimator estimator(bank);
  const std::vector<double> y(bank.output_names.size(), 1.0), u(bank.input_names.size(), -1.0);
  for (std::uint32_t k = 0; k < 3; ++k) {
    filters.step(y, u);
    evaluator.step(filters.evaluation(), filters.thresholds());
    const Decision decision = table.decide(evaluator.signature(), evaluator.persistent());
    estimates.push(k, evaluator.fired(), filters.residual());
    estimator.push(k, filters.residual());
    if (decision.verdict != Verdict::kIsolated) continue;
    const std::vector<std::size_t>& set = table.sets()[decision.sets[0]];
    static_cast<void>(estimator.estimate(set, 0));
    if (estimates.can_estimate(set)) static_cast<void>(estimates.estimate(set));
  }
}

/// Paths of all values below `value`, itself included.
void collect(const Json& value, const Json::json_pointer& at,
             std::vector<Json::json_pointer>& paths) {
  paths.push_back(at);
  if (value.is_array()) {
    for (std::size_t i = 0; i < value.size(); ++i) collect(value[i], at / i, paths);
  } else if (value.is_object()) {
    for (const auto& [key, member] : value.items()) collect(member, at / key, paths);
  }
}

struct Outcome {
  std::size_t refused = 0, run = 0;
};

Outcome replace_every_value(const Bank& bank) {
  const Json original = Json::parse(bank_text(bank));
  std::vector<Json::json_pointer> paths;
  collect(original, Json::json_pointer(), paths);
  const std::vector<Json> hostile = {nullptr,
                                     "sin",
                                     "y1",
                                     -1,
                                     0,
                                     4294967295U,
                                     0.5,
                                     -1e308,
                                     1e308,
                                     Json::array(),
                                     Json::object(),
                                     Json::array({Json::array({0.5})})};
  Outcome outcome;
  for (const Json::json_pointer& path : paths) {
    for (const Json& value : hostile) {
      Json changed = original;
      changed[path] = value;
      try {
        run(parse_bank(changed.dump(), "b.json"));
        ++outcome.run;
      } catch (const BankFileError& error) {
        EXPECT_EQ(std::string(error.what()).rfind("b.json:1:", 0), 0u) << error.what();
        ++outcome.refused;
      }
    }
  }
  return outcome;
}

TEST(HostileBank, IsRefusedOrRunsWhateverAValueOfAnObserverIsReplacedBy) {
  const Outcome outcome = replace_every_value(observer_bank());
  EXPECT_GT(outcome.refused, 3000u);
  EXPECT_GT(outcome.run, 500u);
}

TEST(HostileBank, IsRefusedOrRunsWhateverAValueOfALinearFilterIsReplacedBy) {
  Bank bank = hou_bank();
  bank.filters.resize(2);
  const Outcome outcome = replace_every_value(bank);
  EXPECT_GT(outcome.refused, 1000u);
  EXPECT_GT(outcome.run, 100u);
}

}  // namespace
}  // namespace faultline

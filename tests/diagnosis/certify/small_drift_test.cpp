// What sequential tests are for: faults far below the smallest that the plain comparison finds, at
// the same rate of false alarms.
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "diagnosis/certify/certify.h"
#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/discretize.h"
#include "diagnosis/model/plant_file.h"
#include "diagnosis/model/riccati.h"
#include "diagnosis/runtime/evaluator.h"
#include "diagnosis/runtime/residual_bank.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSampleTime_s = 0.01;
constexpr double kSigma = 0.05;
constexpr int kOnset = 1000;      // samples
constexpr int kRamp = 1000;       // the drift takes 10 s
constexpr int kSamples = 12'000;  // two minutes
constexpr int kRuns = 20;

PlantModel noisy_plant() {
  std::string text = hou_plant_text();
  const std::string states = R"(names = ["x1", "x2", "x3"])";
  text.insert(text.find(states) + states.size(), "\nrange = [2, 3, 4]");
  for (const char* output : {"[1, 0, 0]", "[0, 1, 0]", "[0, 0, 1]"}) {
    text += fmt::format("[[noise]]\noutput = {}\nsigma = {}\n", output, kSigma);
  }
  return parse_plant(text, "plant.toml");
}

Bank bank_with(const PlantModel& plant, const std::string& test) {
  Bank bank = design_bank(plant, parse_bank_request(R"(
schema = 1
name   = "pairs"
plant  = "plant.toml"
method = "geometric"
concurrent    = 2
poles  = [0.905]
sample_time_s = 0.01
domain = "sampled"
[decision]
threshold = "certified"
false_alarms_per_h = 0.01
test = ")" + test + "\"\n",
                                                    "bank.toml"))
                  .bank;
  certify(plant, bank);
  return bank;
}

// The fault that drifts in: samples from its onset until each residual that sees it has fired, the
// slowest; infinity: never. And whether one that ignores it has fired.
struct Answer {
  double delay = 0.0;
  bool is_false = false;
};

Answer drift(const PlantModel& plant, const Bank& bank, std::size_t fault, double size,
             std::uint64_t seed) {
  const SampledSystem step = discretize_zoh(plant.A, plant.B, kSampleTime_s);
  const MatrixXd K = lqr_gain(step.A, step.B, MatrixXd::Identity(3, 3), MatrixXd::Identity(4, 4));
  std::mt19937_64 draw(seed);
  std::normal_distribution<double> normal(0.0, kSigma);
  ResidualBank filters(bank);
  Evaluator evaluator(bank);
  evaluator.contaminate_start();
  VectorXd x = VectorXd::Zero(3);
  std::vector<double> fired(bank.filters.size(), std::numeric_limits<double>::infinity());
  Answer answer;
  for (int k = 0; k < kSamples; ++k) {
    const VectorXd y = plant.C * x + VectorXd::NullaryExpr(3, [&] { return normal(draw); });
    const VectorXd u = -K * x;
    filters.step({y.data(), 3}, {u.data(), 4});
    evaluator.step(filters.evaluation(), filters.thresholds());
    filters.restart_tests(evaluator.contaminated());
    for (std::size_t f = 0; f < fired.size(); ++f) {
      if (evaluator.fired()[f] == 0) continue;
      fired[f] = std::min(fired[f], static_cast<double>(k - kOnset));
      const bool is_seen = bank.filters[f].sees[fault] != Sensitivity::kNone;
      answer.is_false = answer.is_false || !is_seen || k < kOnset;
    }
    const double grown = std::clamp(static_cast<double>(k - kOnset) / kRamp, 0.0, 1.0);
    VectorXd acting = u;
    acting[static_cast<Eigen::Index>(fault)] += grown * size;
    x = step.A * x + step.B * acting;
  }
  for (std::size_t f = 0; f < fired.size(); ++f) {
    if (bank.filters[f].sees[fault] != Sensitivity::kNone) {
      answer.delay = std::max(answer.delay, fired[f]);
    }
  }
  return answer;
}

TEST(SequentialTest, FindsADriftOfATenthOfWhatTheComparisonFinds) {
  const PlantModel plant = noisy_plant();
  const Bank plain = bank_with(plant, "comparison");
  const std::uint64_t seed = test_seed(20261216);
  SCOPED_TRACE(seed_message(seed));
  for (const char* test : {"cusum", "glr"}) {
    const Bank bank = bank_with(plant, test);
    for (std::size_t fault = 0; fault < 4; ++fault) {
      // What each residual that sees it must have to fire by itself.
      double smallest = 0.0;
      for (const ResidualFilter& filter : plain.filters) {
        smallest = std::max(smallest, filter.certificate.smallest_fault[fault]);
      }
      double slowest = 0.0;
      int found = 0, found_by_plain = 0, wrong = 0;
      for (int run = 0; run < kRuns; ++run) {
        const std::uint64_t own = seed + 100 * fault + static_cast<std::uint64_t>(run);
        const Answer answer = drift(plant, bank, fault, 0.1 * smallest, own);
        found += std::isfinite(answer.delay) ? 1 : 0;
        wrong += answer.is_false ? 1 : 0;
        slowest = std::max(slowest, answer.delay);
        const Answer by_plain = drift(plant, plain, fault, 0.1 * smallest, own);
        found_by_plain += std::isfinite(by_plain.delay) ? 1 : 0;
      }
      EXPECT_EQ(found, kRuns) << test << ' ' << plant.faults[fault].name;
      EXPECT_EQ(found_by_plain, 0) << plant.faults[fault].name;
      EXPECT_EQ(wrong, 0) << test << ' ' << plant.faults[fault].name;
      fmt::print(
          "{} {}: a drift to {:.3g}, where the comparison takes {:.3g}: isolated in {} of {} "
          "runs, {:.1f} s after it began at the latest\n",
          test, plant.faults[fault].name, 0.1 * smallest, smallest, found, kRuns,
          slowest * kSampleTime_s);
    }
  }
}

}  // namespace
}  // namespace faultline

// Random plants from their files to the verdict, on the loop bus: every fault and every pair that
// the theory can tell is isolated at twice the size that just does; what it cannot tell gets the
// verdict that the bank predicts.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/LU>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include "diagnosis/runtime/decision.h"
#include "tests/diagnosis/design/reference_geometry.h"
#include "tests/support/random_plant.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using FaultSet = std::vector<std::size_t>;

constexpr double kThreshold = 0.5;    // of a normalised bank: half a fault size
constexpr double kResolution = 1e-6;  // of a signal: 32 bits reach ±2147
constexpr double kSampleTime_s = 0.01;
// From the fault on: six of the plants' slowest time constants (2 1/s), so that what first-order
// hold lets through of their transients is gone.
constexpr double kAfterOnset_s = 3.0;
// Steady residuals this close to the threshold, relative to it, cannot be predicted.
constexpr double kTooClose = 0.02;

struct Case {
  BenchPlantRecipe recipe;
  std::size_t concurrent = 1;
  DesignDomain domain = DesignDomain::kContinuous;
};

void PrintTo(const Case& entry, std::ostream* out) {
  *out << entry.recipe << ", p = " << entry.concurrent
       << (entry.domain == DesignDomain::kSampled ? ", sampled" : ", continuous");
}

// ------------------------------------------------------------------------------------ the files

std::string row_text(const VectorXd& row) {
  std::vector<std::string> numbers;
  for (const double value : row) numbers.push_back(fmt::format("{:.17g}", value));
  return fmt::format("[{}]", fmt::join(numbers, ", "));
}

std::string matrix_text(const MatrixXd& X) {
  std::vector<std::string> rows;
  for (Index i = 0; i < X.rows(); ++i) rows.push_back(row_text(X.row(i).transpose()));
  return fmt::format("[{}]", fmt::join(rows, ",\n  "));
}

std::string names_text(const std::vector<std::string>& names) {
  std::vector<std::string> quoted;
  for (const std::string& name : names) quoted.push_back('"' + name + '"');
  return fmt::format("[{}]", fmt::join(quoted, ", "));
}

std::vector<std::string> faults_of(const PlantModel& plant, FaultKind kind) {
  std::vector<std::string> names;
  for (const Fault& fault : plant.faults) {
    if (fault.kind == kind) names.push_back(fault.name);
  }
  return names;
}

std::string plant_text(const PlantModel& plant) {
  const bool is_discrete = plant.time == TimeDomain::kDiscrete;
  std::string text = fmt::format(
      "schema = 1\nname = \"random\"\ntime = \"{}\"\n{}[states]\nnames = {}\n[inputs]\nnames = {}\n"
      "[outputs]\nnames = {}\n[dynamics]\nA = {}\nB = {}\nC = {}\n[faults]\nactuators = {}\n"
      "sensors = {}\n",
      is_discrete ? "discrete" : "continuous",
      is_discrete ? fmt::format("sample_time_s = {}\n", *plant.sample_time_s) : "",
      names_text(plant.state_names), names_text(plant.input_names), names_text(plant.output_names),
      matrix_text(plant.A), matrix_text(plant.B), matrix_text(plant.C),
      names_text(faults_of(plant, FaultKind::kActuator)),
      names_text(faults_of(plant, FaultKind::kSensor)));
  for (const Disturbance& disturbance : plant.disturbances) {
    text +=
        fmt::format("[[disturbance]]\nname = \"{}\"\nstate = {}\noutput = {}\n", disturbance.name,
                    row_text(disturbance.state), row_text(disturbance.output));
  }
  return text;
}

std::string bank_text_of(const Case& entry, const PlantModel& plant) {
  std::vector<std::string> poles, decouple;
  for (Index i = 0; i < plant.n(); ++i) {
    const double pole = -16.0 - 3.0 * static_cast<double>(i);
    poles.push_back(fmt::format(
        "{:.6f}", entry.domain == DesignDomain::kSampled ? std::exp(pole * kSampleTime_s) : pole));
  }
  for (const Disturbance& disturbance : plant.disturbances) decouple.push_back(disturbance.name);
  return fmt::format(
      "schema = 1\nname = \"random\"\nplant = \"plant.toml\"\nmethod = \"geometric\"\n"
      "concurrent = {}\npoles = [{}]\ndomain = \"{}\"\nsample_time_s = {}\ndecouple = {}\n"
      "[decision]\nthreshold = {}\n",
      entry.concurrent, fmt::join(poles, ", "),
      entry.domain == DesignDomain::kSampled ? "sampled" : "continuous", kSampleTime_s,
      names_text(decouple), kThreshold);
}

// A message per channel: 32 bits of value, 8 of cycle.
std::string dbc_text(const PlantModel& plant) {
  std::string text =
      "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: Plant Controller Diagnosis\n\n"
      "BO_ 256 Sync: 8 Plant\n"
      " SG_ SyncCycle : 0|32@1+ (1,0) [0|4294967295] \"\" Controller,Diagnosis\n"
      " SG_ SyncCommandCycle : 32|32@1+ (1,0) [0|4294967295] \"\" Diagnosis\n\n";
  std::string roles =
      "BA_DEF_ SG_ \"FaultlineRole\" ENUM "
      "\"none\",\"sync\",\"cycle\",\"command_cycle\",\"alive\",\"crc\";\n"
      "BA_DEF_DEF_ \"FaultlineRole\" \"none\";\n"
      "BA_ \"FaultlineRole\" SG_ 256 SyncCycle 1;\n"
      "BA_ \"FaultlineRole\" SG_ 256 SyncCommandCycle 3;\n";
  const auto add = [&](int first_id, const std::vector<std::string>& names, const char* sender,
                       const char* receivers) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      const int id = first_id + static_cast<int>(i);
      text += fmt::format(
          "BO_ {0} Message_{1}: 5 {2}\n SG_ {1} : 0|32@1- ({3},0) [-2147|2147] \"\" {4}\n"
          " SG_ Cycle_{1} : 32|8@1+ (1,0) [0|255] \"\" {4}\n\n",
          id, names[i], sender, kResolution, receivers);
      roles += fmt::format("BA_ \"FaultlineRole\" SG_ {} Cycle_{} 2;\n", id, names[i]);
    }
  };
  add(272, plant.output_names, "Plant", "Controller,Diagnosis");
  add(512, plant.input_names, "Controller", "Plant,Diagnosis");
  return text + roles;
}

std::string scenario_text(const PlantModel& plant) {
  return fmt::format(
      "schema = 1\nname = \"random\"\nplant = \"plant.toml\"\nbank = \"bank.toml\"\n"
      "dbc = \"bench.dbc\"\nduration_s = 1.0\nseed = 1\n[controller]\nkind = \"none\"\n"
      "feedforward = {}\n",
      row_text(VectorXd::Ones(plant.m())));
}

void write(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file);
  out << text;
  ASSERT_TRUE(out.good()) << file;
}

// ---------------------------------------------------------------------------------- predictions

/// What a bank makes of constant faults of its plant once it has settled.
class Prediction {
 public:
  explicit Prediction(const Bank& bank) : bank_(bank), table_(bank) {
    for (const ResidualFilter& filter : bank.filters) {
      const MatrixXd I = MatrixXd::Identity(filter.F.rows(), filter.F.rows());
      MatrixXd gain = filter.J;
      if (filter.F.rows() > 0) gain += filter.M * (I - filter.F).lu().solve(filter.L);
      gains_.push_back(gain);
    }
  }

  /// Steady evaluation of residual i.
  [[nodiscard]] double residual(std::size_t i, const VectorXd& faults) const {
    return (gains_[i] * faults).norm();
  }

  [[nodiscard]] bool sees(std::size_t i, const FaultSet& faults, Sensitivity how) const {
    return std::any_of(faults.begin(), faults.end(),
                       [&](std::size_t j) { return bank_.filters[i].sees[j] == how; });
  }

  /// Every residual that sees a fault of the set steadily fires; or none needs to.
  [[nodiscard]] bool is_isolating(const FaultSet& set, const VectorXd& faults) const {
    for (std::size_t i = 0; i < gains_.size(); ++i) {
      if (sees(i, set, Sensitivity::kSteady) && !(residual(i, faults) > kThreshold)) return false;
    }
    return true;
  }

  /// A fault's smallest isolating size: τ over its smallest DC gain where it is seen.
  [[nodiscard]] double smallest_size(std::size_t j) const {
    double size = 0.0;
    for (std::size_t i = 0; i < gains_.size(); ++i) {
      if (sees(i, {j}, Sensitivity::kSteady)) {
        size = std::max(size, kThreshold / gains_[i].col(static_cast<Index>(j)).norm());
      }
    }
    return size;
  }

  [[nodiscard]] bool is_too_close(const VectorXd& faults) const {
    for (std::size_t i = 0; i < gains_.size(); ++i) {
      if (std::abs(residual(i, faults) / kThreshold - 1.0) < kTooClose) return true;
    }
    return false;
  }

  [[nodiscard]] VerdictEntry verdict(const VectorXd& faults) const {
    std::vector<std::uint64_t> signature((gains_.size() + 63) / 64);
    for (std::size_t i = 0; i < gains_.size(); ++i) {
      if (residual(i, faults) > kThreshold) signature[i / 64] |= std::uint64_t{1} << (i % 64);
    }
    const Decision decision = table_.decide(signature);
    VerdictEntry entry;
    entry.verdict = decision.verdict;
    if (decision.verdict == Verdict::kIsolated || decision.verdict == Verdict::kAmbiguous) {
      for (std::uint32_t s = 0;
           s < std::min<std::uint32_t>(decision.set_count, Decision::kMaxListed); ++s) {
        entry.sets.push_back(names(table_.sets()[decision.sets[s]]));
      }
    }
    return entry;
  }

  [[nodiscard]] std::vector<std::string> names(const FaultSet& set) const {
    std::vector<std::string> found;
    for (const std::size_t j : set) found.push_back(bank_.fault_names[j]);
    std::sort(found.begin(), found.end());
    return found;
  }

 private:
  const Bank& bank_;
  DecisionTable table_;
  std::vector<MatrixXd> gains_;
};

std::vector<FaultSet> sets_of(std::size_t fault_count, std::size_t size) {
  std::vector<FaultSet> sets;
  for (std::size_t i = 0; i < fault_count; ++i) {
    if (size == 1) sets.push_back({i});
    for (std::size_t j = i + 1; j < fault_count && size == 2; ++j) sets.push_back({i, j});
  }
  return sets;
}

FaultSet sum(const FaultSet& a, const FaultSet& b) {
  FaultSet both;
  std::set_union(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(both));
  return both;
}

// Some other set of as many faults can look the same for all time: the columns of both, beside
// those of the disturbances that are decoupled, are dependent.
bool is_confusable(const PlantModel& plant, const FaultSet& set) {
  const std::complex<double> somewhere(1.7, 2.3);
  const Directions disturbances = reference::disturbance_directions(plant);
  const auto rank_of = [&](const FaultSet& faults) {
    return reference::rank(reference::transfer(
        plant, reference::side_by_side(reference::fault_directions(plant, faults), disturbances),
        somewhere));
  };
  const Index alone = rank_of({});
  for (const FaultSet& other : sets_of(plant.faults.size(), set.size())) {
    const FaultSet both = sum(set, other);
    if (other != set && rank_of(both) < alone + std::ssize(both)) return true;
  }
  return false;
}

bool is_transient_only(const Bank& bank, const FaultSet& set) {
  return std::any_of(bank.filters.begin(), bank.filters.end(), [&](const auto& filter) {
    return std::any_of(set.begin(), set.end(),
                       [&](std::size_t j) { return filter.sees[j] == Sensitivity::kTransient; });
  });
}

/// The faults to inject: twice the smallest isolating sizes. For a pair the smallest common factor
/// on its single sizes at which every residual that sees one of them exceeds τ; if they cancel in
/// some residual at every size: the single sizes. A fault that fades from all residuals: size one.
struct Dose {
  VectorXd faults;
  bool isolates = false;
};

Dose twice_the_smallest(const Prediction& prediction, Index fault_count, const FaultSet& set) {
  Dose dose{VectorXd::Zero(fault_count)};
  for (const std::size_t j : set) {
    const double size = prediction.smallest_size(j);
    dose.faults[static_cast<Index>(j)] = size > 0.0 ? size : 1.0;  // fades: any size
  }
  // Residuals grow in proportion: the factor for each is τ over what it is now.
  constexpr double kLargestFactor = 50.0;  // beyond it they cancel for what signals can carry
  constexpr double kStep = 1.02;
  double factor = 1.0;
  while (factor < kLargestFactor &&
         !prediction.is_isolating(set, factor * (1.0 + 1e-9) * dose.faults)) {
    factor *= kStep;
  }
  dose.isolates = factor < kLargestFactor;
  dose.faults *= 2.0 * (dose.isolates ? factor : 1.0);
  while (prediction.is_too_close(dose.faults)) dose.faults *= kStep;
  return dose;
}

// ----------------------------------------------------------------------------------------- runs

class RandomPlants : public testing::TestWithParam<Case> {
 protected:
  void SetUp() override {
    const PlantModel plant = random_bench_plant(GetParam().recipe);
    write(folder_.path() / "plant.toml", plant_text(plant));
    write(folder_.path() / "bank.toml", bank_text_of(GetParam(), plant));
    write(folder_.path() / "bench.dbc", dbc_text(plant));
    write(folder_.path() / "scenario.toml", scenario_text(plant));
    inputs_.emplace(load_bench_inputs(folder_.path() / "scenario.toml"));  // throws: not solvable
    ASSERT_EQ(plant_digest(inputs_->plant), plant_digest(plant)) << "the files say something else";
    std::uint32_t forget = 0;
    for (const ResidualFilter& filter : inputs_->bank.filters) {
      forget = std::max(forget, filter.forget_samples);
    }
    onset_s_ = (forget + 10) * kSampleTime_s;
    inputs_->scenario.duration_s = onset_s_ + kAfterOnset_s;
  }

  BenchResult run(const VectorXd& faults) {
    std::vector<Injection> injections;
    for (Index j = 0; j < faults.size(); ++j) {
      if (faults[j] == 0.0) continue;
      Injection injection;
      injection.target = inputs_->bank.fault_names[static_cast<std::size_t>(j)];
      injection.value = faults[j];
      injection.at_s = onset_s_;
      injections.push_back(injection);
    }
    inputs_->scenario.injections = injections;
    inputs_->schedule = FaultSchedule(inputs_->plant, injections);
    BenchOptions options;
    options.bus = "loop";
    BenchResult result = run_bench(*inputs_, options);
    EXPECT_FALSE(result.stop_reason.has_value());
    EXPECT_EQ(result.counters.clamped_values, 0U);
    EXPECT_EQ(result.counters.bad_samples, 0U);
    return result;
  }

  TemporaryFolder folder_;
  std::optional<BenchInputs> inputs_;
  double onset_s_ = 0.0;
};

// Half an LSB on every channel, through Σ |M F^i E| + |H| and the same of the inputs.
TEST_P(RandomPlants, HaveSignalsFineEnoughForTheirThresholds) {
  for (const ResidualFilter& filter : inputs_->bank.filters) {
    VectorXd worst = (filter.H.cwiseAbs().rowwise().sum() + filter.K.cwiseAbs().rowwise().sum());
    MatrixXd power = filter.M;
    for (int i = 0; i < 400; ++i) {
      worst += (power * filter.E).cwiseAbs().rowwise().sum() +
               (power * filter.G).cwiseAbs().rowwise().sum();
      power = (power * filter.F).eval();
    }
    EXPECT_LT(0.5 * kResolution * worst.norm(), 0.01 * kThreshold) << filter.name;
  }
}

TEST_P(RandomPlants, FireNothingWhileHealthy) {
  const BenchResult result = run(VectorXd::Zero(std::ssize(inputs_->plant.faults)));
  for (std::size_t i = 0; i < inputs_->bank.filters.size(); ++i) {
    EXPECT_FALSE(result.history.first_fired_s()[i].has_value()) << inputs_->bank.filters[i].name;
  }
  ASSERT_FALSE(result.history.verdicts().empty());
  EXPECT_EQ(verdict_text(result.history.verdicts().back()), "healthy");
}

TEST_P(RandomPlants, HaveTheirFaultsIsolated) {
  const Prediction prediction(inputs_->bank);
  const Index fault_count = std::ssize(inputs_->plant.faults);
  int isolated = 0;
  for (std::size_t size = 1; size <= GetParam().concurrent; ++size) {
    for (const FaultSet& set : sets_of(inputs_->plant.faults.size(), size)) {
      const Dose dose = twice_the_smallest(prediction, fault_count, set);
      const std::vector<std::string> names = prediction.names(set);
      SCOPED_TRACE(fmt::format("{} of {}", names, row_text(dose.faults)));
      const BenchResult result = run(dose.faults);
      ASSERT_FALSE(result.history.verdicts().empty());
      const VerdictEntry& found = result.history.verdicts().back();
      if (dose.isolates && !is_confusable(inputs_->plant, set) &&
          !is_transient_only(inputs_->bank, set)) {
        EXPECT_EQ(verdict_text(found), fmt::format("isolated {}", fmt::join(names, ", ")));
        ++isolated;
      }
      const VerdictEntry expected = prediction.verdict(dose.faults);
      EXPECT_EQ(found.verdict, expected.verdict)
          << verdict_text(found) << ", predicted " << verdict_text(expected);
      if (!expected.sets.empty()) {
        EXPECT_EQ(found.sets, expected.sets);
      }
    }
  }
  EXPECT_GT(isolated, 0);
}

std::vector<Case> cases() {
  constexpr auto kContinuous = TimeDomain::kContinuous;
  constexpr auto kDiscrete = TimeDomain::kDiscrete;
  std::vector<Case> list;
  const auto add = [&](const BenchPlantRecipe& recipe, std::size_t concurrent) {
    const bool is_sampled = recipe.time == kDiscrete || recipe.seed % 3 == 0;
    list.push_back(
        {recipe, concurrent, is_sampled ? DesignDomain::kSampled : DesignDomain::kContinuous});
  };
  // n, m, q, sensor faults, disturbances, washout, time, seed; p
  add({3, 3, 3, 0, 0, false, kContinuous, 1}, 1);
  add({4, 3, 2, 0, 0, false, kContinuous, 2}, 1);
  add({4, 3, 3, 0, 0, false, kContinuous, 3}, 1);
  add({5, 3, 3, 1, 0, false, kContinuous, 4}, 1);
  add({5, 4, 3, 0, 1, false, kContinuous, 5}, 1);
  add({6, 4, 4, 2, 0, false, kContinuous, 6}, 1);
  add({6, 5, 3, 0, 0, false, kContinuous, 7}, 1);
  add({4, 3, 4, 2, 1, false, kContinuous, 8}, 1);
  add({4, 3, 2, 0, 0, false, kDiscrete, 9}, 1);
  add({4, 4, 3, 1, 0, false, kDiscrete, 10}, 1);
  add({5, 5, 3, 0, 1, false, kDiscrete, 11}, 1);
  add({6, 3, 4, 2, 0, false, kDiscrete, 12}, 1);
  add({4, 4, 4, 0, 0, false, kContinuous, 13}, 2);
  add({5, 4, 4, 0, 0, false, kContinuous, 14}, 2);
  add({5, 3, 3, 0, 0, false, kContinuous, 15}, 2);
  add({6, 5, 4, 0, 0, false, kContinuous, 16}, 2);
  add({6, 3, 4, 1, 0, false, kContinuous, 17}, 2);
  add({6, 4, 5, 0, 1, false, kContinuous, 18}, 2);
  add({5, 4, 4, 0, 0, false, kDiscrete, 19}, 2);
  add({6, 3, 4, 1, 0, false, kDiscrete, 20}, 2);
  add({6, 5, 4, 0, 0, false, kDiscrete, 21}, 2);
  add({7, 4, 5, 0, 1, false, kDiscrete, 22}, 2);
  // Four columns on three outputs: any two pairs can look the same.
  add({5, 4, 3, 0, 0, false, kContinuous, 23}, 2);
  add({5, 4, 3, 0, 0, false, kDiscrete, 24}, 2);
  // A fault that fades from all residuals.
  add({5, 3, 3, 0, 0, true, kContinuous, 25}, 1);
  add({6, 4, 4, 0, 0, true, kContinuous, 27}, 2);
  add({5, 3, 3, 1, 0, true, kDiscrete, 26}, 1);
  return list;
}

INSTANTIATE_TEST_SUITE_P(OnTheBench, RandomPlants, testing::ValuesIn(cases()),
                         [](const auto& entry) {
                           return fmt::format("seed{}", entry.param.recipe.seed);
                         });

}  // namespace
}  // namespace faultline

#include <cmath>
#include <ostream>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/certify/certify.h"
#include "diagnosis/certify/check.h"
#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/discretize.h"
#include "diagnosis/model/plant_file.h"
#include "diagnosis/runtime/residual_bank.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/diagnosis/threshold_trial.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using testing::HasSubstr;

// Hou's plant with ranges, noise in every output, and whatever else.
std::string plant_text(const std::string& more = "", bool has_range = true) {
  std::string text = hou_plant_text() + R"(
[[noise]]
output = [1, 0, 0]
bound  = 0.01
sigma  = 0.003
[[noise]]
output = [0, 1, 0.5]
bound  = 0.02
sigma  = 0.006
)" + more;
  const std::string states = R"(names = ["x1", "x2", "x3"])";
  if (has_range) text.insert(text.find(states) + states.size(), "\nrange = [2, 3, 4]");
  return text;
}

std::string request_text(const std::string& domain, const std::string& decision,
                         const std::string& more = "") {
  return R"(
schema = 1
name   = "certified"
plant  = "plant.toml"
method = "geometric"
concurrent    = 2
decay_rate_per_s = 10.0
sample_time_s = 0.01
domain = ")" +
         domain + "\"\n" + more + "[decision]\n" + decision;
}

Bank certified(const PlantModel& plant, const std::string& request) {
  Bank bank = design_bank(plant, parse_bank_request(request, "bank.toml")).bank;
  certify(plant, bank);
  return bank;
}

std::string refusal(const PlantModel& plant, const std::string& request) {
  try {
    static_cast<void>(certified(plant, request));
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

struct TrialCase {
  std::string name, domain, decision, plant, more;
  double reached;  // by the worst course, of the threshold; 0: the leak has no worst course
};

void PrintTo(const TrialCase& one, std::ostream* out) { *out << one.name; }

class CertifiedThresholdTrial : public testing::TestWithParam<TrialCase> {};

TEST_P(CertifiedThresholdTrial, IsNeverCrossedAndNearlyReached) {
  const TrialCase& one = GetParam();
  const PlantModel plant = parse_plant(plant_text(one.plant), "plant.toml");
  const Bank bank = certified(plant, request_text(one.domain, one.decision, one.more));
  ASSERT_FALSE(bank.filters.empty());
  const std::uint64_t seed = test_seed(20261201);
  SCOPED_TRACE(seed_message(seed));
  const ThresholdTrial::Result result = ThresholdTrial(plant, bank, seed).run(200'000);
  EXPECT_EQ(result.crossings, 0u) << result.largest;
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    EXPECT_GE(result.largest_of_worst[f], one.reached) << bank.filters[f].name;
  }
  // A tenth less would not do.
  Bank lower = bank;
  for (ResidualFilter& filter : lower.filters) {
    filter.course->component *= 0.9;
    filter.course->norm *= 0.9;
  }
  if (one.reached > 0.0) {
    EXPECT_GT(ThresholdTrial(plant, lower, seed).run(20'000).crossings, 0u);
  }
}

const std::string kCertified = "threshold = \"certified\"\n";
const std::string kDisturbance = R"(
[[disturbance]]
name  = "wind"
state = [0.1, 0.2, -0.1]
bound = 0.5
)";
INSTANTIATE_TEST_SUITE_P(
    Banks, CertifiedThresholdTrial,
    testing::Values(TrialCase{"noise", "sampled", kCertified, "", "", 0.999},
                    TrialCase{"rounding", "sampled",
                              kCertified + "resolution = {y1 = 0.01, y3 = 0.02}\n", "", "", 0.999},
                    TrialCase{"disturbance", "sampled", kCertified, kDisturbance, "", 0.999},
                    TrialCase{"jitter", "sampled", kCertified + "jitter_s = 0.002\n", "", "", 0.0},
                    TrialCase{"continuous", "continuous", kCertified, "", "", 0.0}),
    [](const auto& param) { return param.param.name; });

// Each source by experiment, on a stable plant in the continuous domain, where inputs leak: one
// sample at its bound, and the sum of what the running bank makes of it.
TEST(CertifiedThreshold, HasTheSharesThatExperimentsGive) {
  std::string text = plant_text(kDisturbance);
  const std::string A = "A = [[1, 1, 1], [0, -1, 2], [2, 0, -4]]";
  ASSERT_NE(text.find(A), std::string::npos);
  text.replace(text.find(A), A.size(), "A = [[-2, 1, 1], [0, -4, 2], [2, 0, -7]]");
  const PlantModel plant = parse_plant(text, "plant.toml");
  constexpr double kLate_s = 0.002;
  const Bank bank = certified(
      plant, request_text("continuous",
                          kCertified + "jitter_s = 0.002\nresolution = {y1 = 0.01, y2 = 0.02}\n"));
  const Eigen::MatrixXd A_d = discretize_zoh(plant.A, plant.B, 0.01).A;
  const Eigen::MatrixXd B_d = discretize_zoh(plant.A, plant.B, 0.01).B;
  const Eigen::MatrixXd E_d = discretize_zoh(plant.A, plant.disturbances[0].state, 0.01).B;
  const Eigen::MatrixXd late = discretize_zoh(plant.A, plant.B, 0.01 - kLate_s).A *
                               discretize_zoh(plant.A, plant.B, kLate_s).B;
  // What the state, an error of y and an input of one sample do to every residual, summed up.
  const auto sums = [&](Eigen::VectorXd x, const Eigen::VectorXd& y_error, Eigen::VectorXd u) {
    ResidualBank filters(bank);
    std::vector<double> sum(bank.filters.size());
    for (int k = 0; k < 3000; ++k) {
      const Eigen::VectorXd y = plant.C * x + (k == 0 ? y_error : Eigen::VectorXd::Zero(3));
      filters.step({y.data(), 3}, {u.data(), 4});
      for (std::size_t f = 0; f < sum.size(); ++f) sum[f] += std::abs(filters.residual()[f]);
      x = A_d * x + B_d * u;
      u.setZero();
    }
    return sum;
  };
  const Eigen::VectorXd x_0 = Eigen::VectorXd::Zero(3), u_0 = Eigen::VectorXd::Zero(4);
  std::vector<std::vector<double>> noise, resolution, disturbance, leakage, jitter;
  for (const Noise& one : plant.noises) noise.push_back(sums(x_0, one.output * *one.bound, u_0));
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double half = 0.5 * bank.thresholds.output_resolution[i];
    resolution.push_back(sums(x_0, half * Eigen::VectorXd::Unit(3, i), u_0));
  }
  disturbance.push_back(sums(0.5 * E_d, x_0, u_0));
  for (Eigen::Index i = 0; i < 4; ++i) {
    const double range = plant.input_range[i];
    leakage.push_back(sums(x_0, x_0, range * Eigen::VectorXd::Unit(4, i)));
    jitter.push_back(sums(2.0 * range * late.col(i), x_0, u_0));
  }
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    SCOPED_TRACE(bank.filters[f].name);
    const auto total = [f](const std::vector<std::vector<double>>& of) {
      double sum = 0.0;
      for (const std::vector<double>& one : of) sum += one[f];
      return sum;
    };
    const ThresholdShares& shares = *bank.filters[f].shares;
    EXPECT_NEAR(shares.noise[0], total(noise), 1e-6 * total(noise));
    EXPECT_NEAR(shares.resolution[0], total(resolution), 1e-6 * total(resolution));
    EXPECT_NEAR(shares.disturbance[0], total(disturbance), 1e-6 * total(disturbance));
    EXPECT_NEAR(shares.leakage[0], total(leakage), 1e-6 * total(leakage));
    EXPECT_GT(shares.leakage[0], 1e-6);
    // Any lateness up to the largest is in it: a little more than that of the largest alone.
    EXPECT_GE(shares.jitter[0], total(jitter));
    EXPECT_LE(shares.jitter[0], 1.03 * total(jitter));
    const double sum = shares.noise[0] + shares.resolution[0] + shares.disturbance[0] +
                       shares.leakage[0] + shares.jitter[0];
    EXPECT_NEAR(bank.filters[f].course->component.bottomRows(1)(0, 0), sum, 1e-6 * sum);
  }
}

TEST(CertifiedThreshold, OfAServoDriveWithUncertainFriction) {
  const PlantModel plant = parse_plant(R"(
schema = 1
name   = "drive"
time   = "continuous"
[states]
names = ["i", "w_m", "torque", "w_l"]
range = [20, 60, 6, 60]
[inputs]
names = ["u"]
range = [24]
[outputs]
names = ["i", "w_motor", "w_load"]
range = [20, 60, 60]
[dynamics]
A = [[-200, -60, 0, 0], [150, -2.5, -500, 0], [0, 8, 0, -8], [0, 0, 100, -2]]
B = [[200], [0], [0], [0]]
C = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
[faults]
actuators = []
sensors   = "all"
[[disturbance]]
name  = "load"
state = [0, 0, 0, 100]
bound = 0.5
[[disturbance]]
name  = "supply"
state = [200, 0, 0, 0]
bound = 0.1
[[noise]]
output = [1, 0, 0]
bound  = 0.05
[[noise]]
output = [0, 1, 0]
bound  = 0.1
[[noise]]
output = [0, 0, 1]
bound  = 0.1
)",
                                       "plant.toml");
  const Bank bank = certified(plant, R"(
schema = 1
name   = "robust"
plant  = "plant.toml"
method = "eigenstructure"
poles  = [0.95, 0.94, 0.93, 0.92]
domain = "sampled"
sample_time_s = 0.001
decouple = ["load"]
[decision]
threshold = "certified"
)");
  const std::uint64_t seed = test_seed(20261202);
  SCOPED_TRACE(seed_message(seed));
  const ThresholdTrial::Result result = ThresholdTrial(plant, bank, seed).run(200'000);
  EXPECT_EQ(result.crossings, 0u) << result.largest;
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    EXPECT_GE(result.largest_of_worst[f], 0.99) << bank.filters[f].name;
  }
}

TEST(CertifiedThreshold, SurvivesTheFileAndItsCheck) {
  const PlantModel plant = parse_plant(plant_text(kDisturbance), "plant.toml");
  for (const std::string& decision :
       {kCertified + "resolution = {y2 = 0.01}\njitter_s = 0.001\nfalse_alarms_per_h = 0.01\n",
        kCertified + "false_alarms_per_h = 0.01\ntest = \"cusum\"\n",
        kCertified + "false_alarms_per_h = 0.01\ntest = \"glr\"\ntuned_for = 0.5\n"}) {
    SCOPED_TRACE(decision);
    const Bank bank = certified(plant, request_text("sampled", decision));
    const std::string text = bank_text(bank);
    Bank again = parse_bank(text, "b.json");
    EXPECT_EQ(bank_text(again), text);
    for (const CheckFinding& finding : check_bank(plant, again).findings) {
      ADD_FAILURE() << sentence(finding);
    }
    // Anything that is lower is found.
    again.filters[1].threshold *= 0.99;
    EXPECT_FALSE(check_bank(plant, again).holds());
    again = parse_bank(text, "b.json");
    if (again.filters[1].course) {
      again.filters[1].course->component *= 0.99;
    } else {
      again.filters[1].test->offset[0] *= 0.5;
    }
    EXPECT_FALSE(check_bank(plant, again).holds());
    again = parse_bank(text, "b.json");
    again.thresholds.false_alarms_per_h *= 0.1;
    EXPECT_FALSE(check_bank(plant, again).holds());
    again = parse_bank(text, "b.json");
    again.thresholds.kind = ThresholdBasis::Kind::kGiven;
    if (again.filters[1].course) {
      EXPECT_FALSE(check_bank(plant, again).holds());
    }
  }
}

// What a bank file may hold, whoever wrote it.
TEST(CertifiedThreshold, ChecksWhateverABankClaims) {
  const PlantModel plant = parse_plant(plant_text(), "plant.toml");
  for (const std::string test : {"cusum", "glr", "comparison"}) {
    const Bank bank =
        certified(plant, request_text("sampled", kCertified +
                                                     "false_alarms_per_h = 0.1\nresolution = {y1 = "
                                                     "0.01}\njitter_s = 1e-5\ntest = \"" +
                                                     test + "\"\n"));
    EXPECT_TRUE(check_bank(plant, bank).holds());
    for (const double number : {1e-300, 1e-9, 1e-3, 100.0, 1e9, 1e300}) {
      for (int what = 0; what < 7; ++what) {
        SCOPED_TRACE(testing::Message() << test << ' ' << what << ' ' << number);
        Bank hostile = bank;
        ResidualFilter& filter = hostile.filters[0];
        if (what == 0) filter.threshold = number;
        if (what == 1) hostile.thresholds.false_alarms_per_h = number;
        if (what == 2) hostile.thresholds.output_resolution[0] = number;
        if (what == 3) hostile.thresholds.jitter_s = number;
        if (what == 4) filter.M *= number;
        if (what == 5 && filter.test) filter.test->reference = number;
        if (what == 6 && filter.test) filter.test->offset[0] = number;
        const bool is_true = check_bank(plant, hostile).holds();
        EXPECT_TRUE(what >= 5 || !is_true);
        ResidualBank filters(hostile);
        filters.step(std::vector<double>{1.0, 2.0, 3.0}, std::vector<double>(4));
      }
    }
  }
}

TEST(CertifiedThreshold, SaysWhatIsMissing) {
  const PlantModel plant = parse_plant(plant_text(), "plant.toml");
  EXPECT_THAT(refusal(parse_plant(plant_text("", false), "p"), request_text("sampled", kCertified)),
              HasSubstr("expected range in [states]"));
  EXPECT_THAT(
      refusal(parse_plant(plant_text("[[noise]]\noutput = [0, 0, 1]\nsigma = 0.1\n"), "p"),
              request_text("sampled", kCertified)),
      HasSubstr("noise3 has no bound; expected bound in its [[noise]], or false_alarms_per_h"));
  EXPECT_THAT(
      refusal(parse_plant(plant_text("[[disturbance]]\nname = \"d\"\nstate = [1, 0, 0]\n"), "p"),
              request_text("sampled", kCertified)),
      HasSubstr("disturbance d reaches it and has no bound"));
  std::string ideal = plant_text();
  ideal.erase(ideal.find("[[noise]]"));
  EXPECT_THAT(refusal(parse_plant(ideal, "p"), request_text("sampled", kCertified)),
              HasSubstr("it would be zero"));
  EXPECT_THAT(refusal(plant, request_text("sampled", kCertified + "resolution = {y9 = 0.1}\n")),
              HasSubstr("found \"y9\", expected outputs of the plant: y1, y2, y3"));
  EXPECT_THAT(refusal(plant, request_text("sampled", kCertified + "jitter_s = 0.02\n")),
              HasSubstr("expected at most the sample time"));
  EXPECT_THAT(refusal(plant, request_text("sampled", "threshold = 0.5\njitter_s = 0.001\n")),
              HasSubstr("only with threshold = \"certified\""));
  EXPECT_THAT(refusal(plant, request_text("sampled", kCertified + "false_alarms_per_h = 1e5\n")),
              HasSubstr("expected at most"));
  EXPECT_THAT(refusal(plant, request_text("sampled", kCertified + "test = \"cusum\"\n")),
              HasSubstr("false_alarms_per_h beside it"));
  EXPECT_THAT(refusal(plant, request_text("sampled", kCertified + "tuned_for = 0.1\n")),
              HasSubstr("only with test"));
  EXPECT_THAT(refusal(plant, request_text("sampled", kCertified + "false_alarms_per_h = 1e-300\n")),
              HasSubstr("expected at least 1e-09"));
  const std::string cusum = kCertified + "false_alarms_per_h = 0.1\ntest = \"cusum\"\n";
  EXPECT_THAT(refusal(plant, request_text("sampled", cusum + "tuned_for = 1e-6\n")),
              HasSubstr("standard deviations, expected at least"));
  // A single sample tells so much: the reference stays where it can be told.
  const Bank large = certified(plant, request_text("sampled", cusum + "tuned_for = 1e9\n"));
  for (const ResidualFilter& filter : large.filters) {
    EXPECT_EQ(filter.test->reference, 10.0);
    EXPECT_GT(filter.threshold, 0.0);
  }
  std::string quiet = plant_text();
  while (quiet.find("sigma") != std::string::npos) {
    quiet.erase(quiet.find("sigma"), quiet.find('\n', quiet.find("sigma")) - quiet.find("sigma"));
  }
  EXPECT_THAT(
      refusal(parse_plant(quiet, "p"),
              request_text("sampled", kCertified + "false_alarms_per_h = 0.1\ntest = \"glr\"\n")),
      HasSubstr("expected sigma in [[noise]]"));
}

// Noise by its sigma: as many alarms as asked for.
TEST(CertifiedThreshold, KeepsItsFalseAlarmRate) {
  const PlantModel plant = parse_plant(plant_text(), "plant.toml");
  constexpr std::uint64_t kSamples = 3'000'000;
  constexpr double kHours = kSamples * 0.01 / 3600.0;
  for (const std::string dwell : {"1", "3", "8"}) {
    SCOPED_TRACE(dwell);
    // 60 an hour: some 500 in all.
    const Bank bank = certified(
        plant, request_text("sampled", kCertified + "false_alarms_per_h = 60\ndwell = " + dwell));
    ResidualBank filters(bank);
    std::mt19937_64 draw(test_seed(20261203));
    std::normal_distribution<double> normal;
    std::vector<double> y(3), u(4);
    const auto per_run = static_cast<std::uint32_t>(std::stoi(dwell));
    std::vector<std::uint32_t> run(bank.filters.size());
    std::vector<double> alarms(bank.filters.size());
    for (std::uint64_t k = 0; k < kSamples; ++k) {
      const double n1 = 0.003 * normal(draw), n2 = 0.006 * normal(draw);
      y = {n1, n2, 0.5 * n2};
      filters.step(y, u);
      for (std::size_t f = 0; f < run.size(); ++f) {
        run[f] = filters.evaluation()[f] > filters.thresholds()[f] ? run[f] + 1 : 0;
        alarms[f] += run[f] == per_run ? 1.0 : 0.0;
      }
    }
    const double expected = 60.0 * kHours / static_cast<double>(bank.filters.size());
    for (std::size_t f = 0; f < run.size(); ++f) {
      // Four standard deviations; input leakage of 1e-12 apart it is exact.
      EXPECT_NEAR(alarms[f], expected, 4.0 * std::sqrt(expected)) << bank.filters[f].name;
    }
  }
}

}  // namespace
}  // namespace faultline

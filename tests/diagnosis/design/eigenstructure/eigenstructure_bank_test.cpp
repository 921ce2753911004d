#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/certify/certify.h"
#include "diagnosis/certify/check.h"
#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/plant_file.h"
#include "tests/diagnosis/design/eigenstructure/eigenstructure_oracle.h"
#include "tests/support/random_plant.h"

namespace faultline {
namespace {

using ::testing::HasSubstr;
using Treatment = BankDisturbance::Treatment;

BankRequest request_of(DesignDomain domain, std::vector<std::string> decouple) {
  BankRequest request;
  request.name = "bank";
  request.method = "eigenstructure";
  request.domain = domain;
  request.sample_time_s = 0.05;
  request.decouple = std::move(decouple);
  request.threshold = 0.5;
  for (int i = 0; i < 8; ++i) {
    const double rate = 2.0 + 0.5 * i;
    request.poles.emplace_back(domain == DesignDomain::kContinuous ? -rate
                                                                   : std::exp(-rate * 0.05));
  }
  return request;
}

// Three states, all measured, two actuators, one unknown input; sensor faults.
PlantModel three_sensors() {
  return parse_plant(R"(
schema = 1
name = "three"
time = "continuous"
[states]
names = ["x1", "x2", "x3"]
[inputs]
names = ["u1"]
[outputs]
names = ["y1", "y2", "y3"]
[dynamics]
A = [[-1, 1, 0], [0, -2, 1], [1, 0, -3]]
B = [[1], [0], [1]]
C = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
[faults]
actuators = []
sensors = "all"
[[disturbance]]
name = "d"
state = [0, 1, 0]
bound = 2.0
)",
                     "three.toml");
}

const EigenstructureReport& assignment(const DesignResult& result, const std::string& name) {
  const auto found = std::find_if(result.assignments.begin(), result.assignments.end(),
                                  [&](const auto& report) { return report.name == name; });
  EXPECT_NE(found, result.assignments.end()) << name;
  return *found;
}

TEST(EigenstructureBank, IgnoresEachSensorAndTheUnknownInput) {
  const PlantModel plant = three_sensors();
  for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
    DesignResult result = design_bank(plant, request_of(domain, {"d"}));
    ASSERT_TRUE(result.is_solvable);
    ASSERT_EQ(result.bank.filters.size(), 3u);
    certify(plant, result.bank);
    const CheckResult check = check_bank(plant, result.bank);
    EXPECT_TRUE(check.holds()) << (check.findings.empty() ? "" : sentence(check.findings[0]));
    for (std::size_t j = 0; j < 3; ++j) {
      const ResidualFilter& filter = result.bank.filters[j];
      EXPECT_EQ(filter.sees[j], Sensitivity::kNone);
      if (domain == DesignDomain::kSampled) {
        EXPECT_LT(filter.certificate.fault_gain[j], 1e-10);
        EXPECT_LT(filter.certificate.disturbance_gain[0], 1e-10);
      }
    }
    EXPECT_EQ(result.bank.disturbances[0].treatment, Treatment::kDecoupled);
  }
}

TEST(EigenstructureBank, DedicatedResidualsSeeOneSensorEach) {
  PlantModel plant = three_sensors();
  plant.disturbances.clear();
  BankRequest request = request_of(DesignDomain::kSampled, {});
  request.structure = StructureChoice::kDedicated;
  DesignResult result = design_bank(plant, request);
  ASSERT_TRUE(result.is_solvable);
  ASSERT_EQ(result.bank.filters.size(), 3u);
  for (const ResidualFilter& filter : result.bank.filters) {
    EXPECT_EQ(std::count(filter.sees.begin(), filter.sees.end(), Sensitivity::kNone), 2)
        << filter.name;
  }
  certify(plant, result.bank);
  EXPECT_TRUE(check_bank(plant, result.bank).holds());
}

TEST(EigenstructureBank, LeftEigenvectorsGiveTheirOrderAndPoles) {
  const PlantModel plant = three_sensors();
  BankRequest request = request_of(DesignDomain::kContinuous, {"d"});
  request.structure = StructureChoice::kGiven;
  request.ignored_sets = {{}};
  const DesignResult result = design_bank(plant, request);
  ASSERT_EQ(result.bank.filters.size(), 1u);
  EXPECT_EQ(assignment(result, "r0").assignment, "left");
  EXPECT_EQ(assignment(result, "r0").existence.left_rows, 2);
  ASSERT_EQ(result.residuals[0].poles.size(), 2u);  // of 3 states: d takes one direction
  EXPECT_NEAR(result.residuals[0].poles[0].real() + result.residuals[0].poles[1].real(), -4.5,
              1e-12);
}

// Every way keeps the unknown input out; certificates are made by other code.
TEST(EigenstructureBank, EveryAssignmentIsProvedByTheCertificate) {
  int counts[3] = {};
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    SCOPED_TRACE(fmt::format("seed {}", seed));
    BenchPlantRecipe recipe;
    recipe.n = 3 + static_cast<Eigen::Index>(seed % 3);
    recipe.q = 2 + static_cast<Eigen::Index>(seed % 2);
    recipe.m = 2;
    recipe.sensor_faults = recipe.q;
    recipe.disturbances = 1;
    recipe.seed = seed;
    const PlantModel plant = random_bench_plant(recipe);
    const AssignmentChoice choices[] = {AssignmentChoice::kLeft, AssignmentChoice::kRight,
                                        AssignmentChoice::kGeometric};
    for (std::size_t c = 0; c < 3; ++c) {
      BankRequest request = request_of(DesignDomain::kSampled, {"d1"});
      request.sample_time_s = 0.01;
      request.eigenstructure.assignment = choices[c];
      request.structure = StructureChoice::kGiven;
      request.ignored_sets = {{}};
      DesignResult result = design_bank(plant, request);
      if (result.bank.filters.empty()) {
        EXPECT_FALSE(result.residuals[0].reason.empty());
        continue;
      }
      ++counts[c];
      certify(plant, result.bank);
      const CheckResult check = check_bank(plant, result.bank);
      EXPECT_TRUE(check.holds()) << (check.findings.empty() ? "" : sentence(check.findings[0]));
      const FilterCertificate& proved = result.bank.filters[0].certificate;
      const double seen = *std::max_element(proved.fault_gain.begin(), proved.fault_gain.end());
      EXPECT_LT(proved.disturbance_gain[0], 1e-8 * seen);
    }
  }
  EXPECT_GE(counts[0], 20);  // those with three outputs of three states
  EXPECT_GT(counts[1], 20);
  EXPECT_GT(counts[2], 40);
}

TEST(EigenstructureBank, SaysWhyOnlyTheGeometricMethodDoes) {
  const auto& item = eigenstructure_oracle().at("geometric_only");
  PlantModel plant = three_sensors();
  plant.A = oracle_matrix(item.at("A"));
  plant.C = oracle_matrix(item.at("C"));
  plant.B = Eigen::MatrixXd::Ones(5, 1);
  plant.D = Eigen::MatrixXd::Zero(2, 1);
  plant.state_names = {"x1", "x2", "x3", "x4", "x5"};
  plant.output_names = {"y1", "y2"};
  plant.output_range = Eigen::VectorXd::Ones(2);
  plant.x_operating = Eigen::VectorXd::Zero(5);
  plant.y_operating = Eigen::VectorXd::Zero(2);
  plant.faults = {
      {"u1", FaultKind::kActuator, plant.B.col(0), Eigen::VectorXd::Zero(2), 1.0},
      {"y1", FaultKind::kSensor, Eigen::VectorXd::Zero(5), Eigen::VectorXd::Unit(2, 0), 1.0}};
  plant.disturbances = {{"d", oracle_matrix(item.at("E")), Eigen::VectorXd::Zero(2), std::nullopt}};
  BankRequest request = request_of(DesignDomain::kContinuous, {"d"});
  request.sample_time_s = 0.01;
  request.structure = StructureChoice::kGiven;
  request.ignored_sets = {{}};
  const DesignResult result = design_bank(plant, request);
  ASSERT_EQ(result.bank.filters.size(), 1u) << result.residuals[0].reason;
  const EigenstructureReport& report = assignment(result, "r0");
  EXPECT_EQ(report.assignment, "geometric");
  EXPECT_THAT(report.explanation, HasSubstr("no left eigenvectors"));
  EXPECT_THAT(report.explanation, HasSubstr("no right eigenvectors"));
  EXPECT_THAT(report.explanation, HasSubstr("rank C W* = 1 < rank C = 2"));
  EXPECT_EQ(result.residuals[0].quotient_dim, 3);
}

TEST(EigenstructureBank, TellsTheNearestThingWhereNothingCanBeDecoupled) {
  PlantModel plant = three_sensors();
  plant.disturbances.push_back(
      {"e", Eigen::Vector3d(1, 0, 0), Eigen::VectorXd::Zero(3), std::nullopt});
  plant.disturbances.push_back(
      {"f", Eigen::Vector3d(0, 0, 1), Eigen::VectorXd::Zero(3), std::nullopt});
  BankRequest request = request_of(DesignDomain::kContinuous, {"d", "e", "f"});
  const DesignResult result = design_bank(plant, request);
  EXPECT_FALSE(result.is_solvable);
  EXPECT_THAT(result.residuals[0].reason, HasSubstr("[eigenstructure] weaken instead of decouple"));
}

class WeakenedBank : public ::testing::TestWithParam<CompromiseCriterion> {};

// Three unknown inputs and three outputs: CE has full row rank.
TEST_P(WeakenedBank, KeepsSmallWhatCannotBeKeptOut) {
  PlantModel plant = three_sensors();
  plant.disturbances.push_back(
      {"e", Eigen::Vector3d(0.2, 0, 0), Eigen::VectorXd::Zero(3), std::nullopt});
  plant.disturbances.push_back(
      {"f", Eigen::Vector3d(0, 0.1, 0.3), Eigen::VectorXd::Zero(3), std::nullopt});
  for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
    BankRequest request = request_of(domain, {});
    request.eigenstructure.weaken = {"d", "e", "f"};
    request.eigenstructure.criterion = GetParam();
    request.structure = StructureChoice::kGiven;
    request.ignored_sets = {{}};
    DesignResult result = design_bank(plant, request);
    ASSERT_EQ(result.bank.filters.size(), 1u) << result.residuals[0].reason;
    const EigenstructureReport& report = assignment(result, "r0");
    EXPECT_EQ(report.assignment, "weakened");
    ASSERT_EQ(report.weakening.size(), 1u);
    const WeakeningReport& weakening = report.weakening[0];
    EXPECT_EQ(weakening.trade_off.size(), 3u);
    EXPECT_EQ(weakening.singular_values.size(), 3u);
    EXPECT_EQ(weakening.rows, result.bank.filters[0].H.rows());
    if (GetParam() == CompromiseCriterion::kWorstCase) {
      EXPECT_LT(weakening.ratio_after, 0.999 * weakening.ratio_before);
    }
    certify(plant, result.bank);
    const CheckResult check = check_bank(plant, result.bank);
    EXPECT_TRUE(check.holds()) << (check.findings.empty() ? "" : sentence(check.findings[0]));
    EXPECT_EQ(result.bank.disturbances[0].treatment, Treatment::kWeakened);
    // The bank file knows it.
    const Bank again = parse_bank(bank_text(result.bank), "bank.json");
    EXPECT_EQ(again.disturbances[2].treatment, Treatment::kWeakened);
    // The certificate's gain of one unknown input is at most that of all together.
    if (GetParam() == CompromiseCriterion::kWorstCase && domain == DesignDomain::kSampled) {
      const std::vector<double>& gain = result.bank.filters[0].certificate.disturbance_gain;
      EXPECT_LE(std::max({2.0 * gain[0], gain[1], gain[2]}), 1.001 * weakening.ratio_after);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Criteria, WeakenedBank,
    ::testing::Values(CompromiseCriterion::kLowRank, CompromiseCriterion::kStatic,
                      CompromiseCriterion::kWorstCase, CompromiseCriterion::kRms),
    [](const auto& criterion) {
      return std::string(std::array{"LowRank", "Static", "WorstCase",
                                    "Rms"}[static_cast<std::size_t>(criterion.param)]);
    });

TEST(EigenstructureBank, TheDecayRateLeavesTheGainFree) {
  PlantModel plant = three_sensors();
  plant.disturbances.push_back(
      {"e", Eigen::Vector3d(0.2, 0, 0), Eigen::VectorXd::Zero(3), std::nullopt});
  plant.disturbances.push_back(
      {"f", Eigen::Vector3d(0, 0.1, 0.3), Eigen::VectorXd::Zero(3), std::nullopt});
  BankRequest request = request_of(DesignDomain::kSampled, {});
  request.poles.clear();
  request.decay_rate_per_s = 1.0;
  request.eigenstructure.weaken = {"d", "e", "f"};
  request.structure = StructureChoice::kGiven;
  request.ignored_sets = {{}};
  const DesignResult result = design_bank(plant, request);
  ASSERT_EQ(result.bank.filters.size(), 1u) << result.residuals[0].reason;
  EXPECT_LE(spectral_radius(result.bank.filters[0].F), std::exp(-0.05) + 1e-9);
  EXPECT_LT(assignment(result, "r0").weakening[0].ratio_after,
            assignment(result, "r0").weakening[0].ratio_before);
}

TEST(EigenstructureBank, DecouplesWhereThatCostsNothing) {
  const PlantModel plant = three_sensors();
  BankRequest request = request_of(DesignDomain::kSampled, {});
  request.eigenstructure.weaken = {"d"};
  request.structure = StructureChoice::kGiven;
  request.ignored_sets = {{}};
  const DesignResult result = design_bank(plant, request);
  EXPECT_EQ(assignment(result, "r0").assignment, "left");
  EXPECT_TRUE(assignment(result, "r0").weakening.empty());
}

TEST(EigenstructureBank, RefusesADisturbanceThatIsAskedForTwice) {
  BankRequest request = request_of(DesignDomain::kSampled, {"d"});
  request.eigenstructure.weaken = {"d"};
  try {
    static_cast<void>(design_bank(three_sensors(), request));
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("found \"d\" twice"));
  }
}

}  // namespace
}  // namespace faultline

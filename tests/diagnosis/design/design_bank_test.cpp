#include "diagnosis/design/design_bank.h"

#include <algorithm>
#include <functional>

#include <Eigen/LU>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/design/subspace.h"
#include "diagnosis/model/discretize.h"
#include "diagnosis/model/plant_file.h"
#include "tests/diagnosis/geometric_oracle.h"
#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::vector<std::size_t> faults_seen(const ResidualFilter& filter, Sensitivity at_least) {
  std::vector<std::size_t> seen;
  for (std::size_t j = 0; j < filter.sees.size(); ++j) {
    if (filter.sees[j] >= at_least) {
      seen.push_back(j);
    }
  }
  return seen;
}

const ResidualFilter* find_filter(const Bank& bank, const std::string& name) {
  const auto found = std::find_if(bank.filters.begin(), bank.filters.end(),
                                  [&](const auto& filter) { return filter.name == name; });
  return found == bank.filters.end() ? nullptr : &*found;
}

std::string refusal(const PlantModel& plant, const BankRequest& request) {
  try {
    static_cast<void>(design_bank(plant, request));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

/// What a filter as implemented does to a plant sampled exactly, with inputs and faults held.
class SampledRun {
 public:
  SampledRun(const PlantModel& plant, const Bank& bank) : plant_(plant), bank_(bank) {
    MatrixXd inputs(plant.n(), plant.m() + fault_count());
    inputs.leftCols(plant.m()) = plant.B;
    for (Index j = 0; j < fault_count(); ++j) {
      inputs.col(plant.m() + j) = plant.faults[static_cast<std::size_t>(j)].state;
    }
    sampled_ = plant.time == TimeDomain::kDiscrete
                   ? SampledSystem{plant.A, inputs}
                   : discretize_zoh(plant.A, inputs, bank.sample_time_s);
  }

  /// Largest |r| of the filter over `steps`, after `skip` of them, with the fault from step 0 on.
  /// The residual does not depend on u once decoupled; a varying one shows if it does.
  double largest_residual(const ResidualFilter& filter, const VectorXd& fault, int skip,
                          int steps) {
    VectorXd x = VectorXd::Zero(plant_.n());
    VectorXd v = VectorXd::Zero(filter.F.rows());
    double largest = 0.0;
    for (int k = 0; k < steps; ++k) {
      VectorXd u(plant_.m());
      for (Index i = 0; i < u.size(); ++i) {
        u[i] = k % 7 == i ? 1.0 : -0.25;
      }
      VectorXd y = plant_.C * x + plant_.D * u;
      for (Index j = 0; j < fault_count(); ++j) {
        y += plant_.faults[static_cast<std::size_t>(j)].output * fault[j];
      }
      const VectorXd r = filter.M * v - filter.H * y + filter.K * u;
      largest = k < skip ? 0.0 : std::max(largest, r.norm());
      v = (filter.F * v - filter.E * y + filter.G * u).eval();
      VectorXd input(u.size() + fault.size());
      input << u, fault;
      x = (sampled_.A * x + sampled_.B * input).eval();
    }
    return largest;
  }

 private:
  [[nodiscard]] Index fault_count() const { return std::ssize(plant_.faults); }

  const PlantModel& plant_;
  const Bank& bank_;
  SampledSystem sampled_;
};

TEST(DesignBank, AgreesWithTheOracleOnAllCases) {
  for (const OracleCase& oracle : oracle_cases()) {
    SCOPED_TRACE(oracle.name);
    const DesignResult result = design_bank(oracle.plant(), oracle.request());
    EXPECT_EQ(result.is_solvable, oracle.is_solvable);
    EXPECT_EQ(result.are_signatures_distinct, oracle.are_signatures_distinct);
    std::vector<std::pair<std::vector<std::size_t>, std::size_t>> failing;
    for (const DesignFailure& failure : result.failing) {
      failing.emplace_back(failure.ignores, failure.fault);
    }
    EXPECT_EQ(failing, oracle.failing);
    ASSERT_EQ(result.residuals.size(), oracle.residuals.size());
    for (std::size_t i = 0; i < result.residuals.size(); ++i) {
      const ResidualReport& report = result.residuals[i];
      const OracleResidual& expected = oracle.residuals[i];
      SCOPED_TRACE(report.name);
      EXPECT_EQ(report.ignores, expected.ignores);
      EXPECT_EQ(report.dim_w, expected.dim_w);
      EXPECT_EQ(report.dim_s, expected.dim_s);
      EXPECT_EQ(report.quotient_dim, expected.quotient_dim);
      EXPECT_EQ(report.rows, expected.rows);
      EXPECT_LT((report.projector_w - expected.projector_w).norm(), 1e-8);
      EXPECT_LT((report.projector_s - expected.projector_s).norm(), 1e-8);
      const ResidualFilter* filter = find_filter(result.bank, report.name);
      ASSERT_NE(filter, nullptr);
      EXPECT_EQ(faults_seen(*filter, Sensitivity::kTransient), expected.responds);
      for (std::size_t j = 0; j < expected.margin.size(); ++j) {
        EXPECT_NEAR(report.margin[j], expected.margin[j], 1e-9);
        const bool is_transient =
            std::count(expected.transient_only.begin(), expected.transient_only.end(), j) > 0;
        EXPECT_EQ(filter->sees[j] == Sensitivity::kTransient, is_transient);
      }
      EXPECT_LT(spectral_radius(filter->F), 1.0);
    }
  }
}

TEST(DesignBank, DecouplesHousMeasurementDisturbancesAsTheProjectionSays) {
  const std::vector<VectorXd> directions = {VectorXd::Unit(3, 0), VectorXd::Unit(3, 1),
                                            VectorXd::Unit(3, 2)};
  for (std::size_t e = 0; e < directions.size(); ++e) {
    PlantModel plant = hou_plant();
    plant.disturbances.push_back({"d", VectorXd::Zero(3), directions[e], {}});
    for (const std::size_t p : {1u, 2u}) {
      BankRequest request = hou_request();
      request.concurrent = p;
      request.decouple = {"d"};
      request.poles = {-10.0, -11.0};
      const DesignResult result = design_bank(plant, request);
      for (const OracleProjection& expected : oracle_projections(fmt::format("e{}", e + 1))) {
        if (expected.ignores.size() != p) {
          continue;
        }
        const auto report =
            std::find_if(result.residuals.begin(), result.residuals.end(),
                         [&](const auto& entry) { return entry.ignores == expected.ignores; });
        ASSERT_NE(report, result.residuals.end());
        SCOPED_TRACE(report->name);
        EXPECT_EQ(report->dim_s, expected.dim_s);
        EXPECT_LT((report->projector_s - expected.projector_s).norm(), 1e-8);
        EXPECT_EQ(report->exists, !expected.responds.empty());
        if (const ResidualFilter* filter = find_filter(result.bank, report->name)) {
          EXPECT_EQ(faults_seen(*filter, Sensitivity::kTransient), expected.responds);
          EXPECT_LT((filter->H * directions[e]).norm(), 1e-12);
          EXPECT_LT((filter->E * directions[e]).norm(), 1e-12);
        }
      }
    }
  }
}

TEST(DesignBank, NormalisesTheSmallestDcGainToOnePerFaultSize) {
  PlantModel plant = hou_plant();
  plant.faults[1].size = 5.0;
  for (const ResidualReport& residual : design_bank(plant, hou_request()).residuals) {
    double smallest = 1e9;
    for (std::size_t j = 0; j < 4; ++j) {
      if (residual.margin[j] > kRankTolerance) {
        smallest = std::min(smallest, residual.dc_gain[j]);
      }
    }
    EXPECT_NEAR(smallest, 1.0, 1e-12) << residual.name;
  }
}

TEST(DesignBank, LeavesThePapersScaleWhenNotNormalised) {
  const DesignResult result = design_bank(hou_plant(), hou_request(false));
  const std::map<std::string, std::vector<double>> gains = {
      {"r12", {0, 0, std::sqrt(0.5) / 10, std::sqrt(0.5) / 10}},
      {"r13", {0, 0.1, 0, 0.1}},
      {"r14", {0, 0.1, 0.1, 0}},
      {"r23", {1 / std::sqrt(300.0), 0, 0, 2 / std::sqrt(300.0)}},
      {"r24", {1 / std::sqrt(1100.0), 0, 2 / std::sqrt(1100.0), 0}},
      {"r34", {1 / std::sqrt(1100.0), 2 / std::sqrt(1100.0), 0, 0}}};
  ASSERT_EQ(result.residuals.size(), gains.size());
  for (const ResidualReport& residual : result.residuals) {
    for (std::size_t j = 0; j < 4; ++j) {
      EXPECT_NEAR(residual.dc_gain[j], gains.at(residual.name)[j], 1e-13) << residual.name;
    }
  }
}

TEST(DesignBank, MakesEachDcGainTheGainOfTheFilterAsImplemented) {
  PlantModel plant = hou_plant();
  plant.A -= 3.0 * MatrixXd::Identity(3, 3);  // stable, so that it can run open loop
  for (Index j = 0; j < 4; ++j) {
    plant.faults[static_cast<std::size_t>(j)].state = plant.B.col(j);
  }
  for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
    BankRequest request = hou_request();
    request.domain = domain;
    request.poles = {domain == DesignDomain::kContinuous ? -10.0 : 0.9};
    const DesignResult result = design_bank(plant, request);
    ASSERT_EQ(result.bank.filters.size(), 6u);
    for (std::size_t i = 0; i < 6; ++i) {
      const ResidualFilter& filter = result.bank.filters[i];
      // Both settled: x = A_d x + B_d m, v = F v - E C x, r = M v - H C x.
      for (Index j = 0; j < 4; ++j) {
        const SampledSystem sampled = discretize_zoh(plant.A, plant.B.col(j), 0.01);
        const VectorXd x = (MatrixXd::Identity(3, 3) - sampled.A).lu().solve(sampled.B.col(0));
        const MatrixXd I = MatrixXd::Identity(filter.F.rows(), filter.F.rows());
        const VectorXd v = (I - filter.F).lu().solve(-filter.E * plant.C * x);
        EXPECT_NEAR((filter.M * v - filter.H * plant.C * x).norm(),
                    result.residuals[i].dc_gain[static_cast<std::size_t>(j)], 1e-8)
            << filter.name;
      }
    }
  }
}

TEST(DesignBank, InTheSampledDomainDecouplesHeldFaultsExactly) {
  for (const OracleCase& oracle : oracle_cases()) {
    if (!oracle.is_solvable) {
      continue;
    }
    SCOPED_TRACE(oracle.name);
    PlantModel plant = oracle.plant();
    plant.A -= 4.0 * MatrixXd::Identity(plant.n(), plant.n());
    BankRequest request = oracle.request();
    request.domain = DesignDomain::kSampled;
    for (std::complex<double>& pole : request.poles) {
      pole = std::exp(pole * request.sample_time_s);
    }
    const DesignResult result = design_bank(plant, request);
    ASSERT_TRUE(result.is_solvable);
    SampledRun run(plant, result.bank);
    const auto none = VectorXd::Zero(std::ssize(plant.faults));
    for (const ResidualFilter& filter : result.bank.filters) {
      EXPECT_LT(run.largest_residual(filter, none, 0, 300), 1e-9);
      for (std::size_t j = 0; j < plant.faults.size(); ++j) {
        const VectorXd fault = VectorXd::Unit(none.size(), static_cast<Index>(j));
        const double largest = run.largest_residual(filter, fault, 0, 300);
        if (filter.sees[j] == Sensitivity::kNone) {
          EXPECT_LT(largest, 1e-9) << filter.name << " and fault " << j;
        } else {
          EXPECT_GT(largest, 1e-3) << filter.name << " and fault " << j;
        }
      }
    }
  }
}

TEST(DesignBank, TakesADiscretePlantAsItIs) {
  PlantModel plant = hou_plant();
  const SampledSystem sampled = discretize_zoh(plant.A, plant.B, 0.01);
  plant.time = TimeDomain::kDiscrete;
  plant.sample_time_s = 0.01;
  plant.A = sampled.A;
  plant.B = sampled.B;
  for (Index j = 0; j < 4; ++j) {
    plant.faults[static_cast<std::size_t>(j)].state = plant.B.col(j);
  }
  BankRequest request = hou_request();
  request.domain = DesignDomain::kSampled;
  request.poles = {0.0};  // dead beat
  const DesignResult result = design_bank(plant, request);
  EXPECT_TRUE(result.is_solvable);
  SampledRun run(plant, result.bank);
  for (const ResidualFilter& filter : result.bank.filters) {
    EXPECT_LT(filter.F.norm(), 1e-10);
    EXPECT_LT(run.largest_residual(filter, VectorXd::Zero(4), 0, 100), 1e-9);
  }
}

TEST(DesignBank, IsolatesSensorFaultsAndFeedthrough) {
  PlantModel plant = parse_plant(R"(schema = 1
name = "sensors"
time = "discrete"
sample_time_s = 0.1
[states]
names = ["a", "b"]
[inputs]
names = ["u"]
[outputs]
names = ["y1", "y2", "y3"]
[dynamics]
A = [[0.5, 0.2], [0, 0.7]]
B = [[1], [0.5]]
C = [[1, 0], [0, 1], [1, 1]]
D = [[0], [0], [2]]
[faults]
actuators = "all"
sensors = ["y1", "y3"]
[[fault]]
name = "leak"
state = [0, 1]
output = [0.5, 0, 0]
size = 2
)",
                                 "plant.toml");
  BankRequest request;
  request.name = "singles";
  request.domain = DesignDomain::kSampled;
  request.poles = {0.3, 0.4};
  request.sample_time_s = 0.1;
  request.threshold = 0.1;
  const DesignResult result = design_bank(plant, request);
  EXPECT_TRUE(result.is_solvable);
  ASSERT_EQ(result.bank.filters.size(), 4u);
  SampledRun run(plant, result.bank);
  for (std::size_t i = 0; i < 4; ++i) {
    const ResidualFilter& filter = result.bank.filters[i];
    EXPECT_LT(run.largest_residual(filter, VectorXd::Zero(4), 0, 200), 1e-12) << filter.name;
    for (std::size_t j = 0; j < 4; ++j) {
      const VectorXd fault = plant.faults[j].size * VectorXd::Unit(4, static_cast<Index>(j));
      if (filter.sees[j] == Sensitivity::kNone) {
        EXPECT_LT(run.largest_residual(filter, fault, 0, 200), 1e-12) << filter.name << j;
      } else {
        EXPECT_NEAR(run.largest_residual(filter, fault, 199, 200), result.residuals[i].dc_gain[j],
                    1e-9)
            << filter.name << j;
      }
    }
  }
}

TEST(DesignBank, ComparesRedundantSensorsWithoutAState) {
  // Nothing is known of the plant but that two sensors measure the same: r = y1 - y2.
  PlantModel plant = parse_plant(R"(schema = 1
name = "twins"
time = "continuous"
[states]
names = ["a"]
[inputs]
names = ["u"]
[outputs]
names = ["y1", "y2"]
[dynamics]
A = [[-1]]
B = [[1]]
C = [[1], [1]]
[faults]
actuators = "all"
sensors = "all"
)",
                                 "plant.toml");
  BankRequest request;
  request.name = "twins";
  request.poles = {-5.0};
  request.sample_time_s = 0.01;
  request.threshold = 0.1;
  const Bank bank = design_bank(plant, request).bank;
  const ResidualFilter* r1 = find_filter(bank, "r1");
  ASSERT_NE(r1, nullptr);
  EXPECT_EQ(r1->F.rows(), 0);
  ASSERT_EQ(r1->H.rows(), 1);
  EXPECT_NEAR(r1->H(0, 0), 1.0, 1e-12);
  EXPECT_NEAR(r1->H(0, 1), -1.0, 1e-12);
  EXPECT_EQ(r1->forget_samples, 1u);
}

TEST(DesignBank, LeavesChannelsThatAResidualDoesNotUseExactlyZero) {
  for (const ResidualFilter& filter : hou_bank().filters) {
    for (const std::size_t j : filter.ignores) {
      EXPECT_EQ(filter.G.col(static_cast<Index>(j)).norm(), 0.0) << filter.name;
    }
  }
}

TEST(DesignBank, ForgetsABadSampleWhenOnePercentOfTheThresholdIsLeft) {
  // |M| e^(-0.1 i) 100 < 0.01·0.05 with |M| = 10: i > 10 ln(1000 / 5e-4) = 145.09; and the sample
  // itself.
  EXPECT_EQ(find_filter(hou_bank(), "r13")->forget_samples, 147u);
}

TEST(DesignBank, ReproducesToTheBit) { EXPECT_EQ(bank_text(hou_bank()), bank_text(hou_bank())); }

TEST(DesignBank, NamesResidualsWithUnderscoresFromTenFaultsOn) {
  PlantModel plant = hou_plant();
  plant.faults.clear();
  for (int j = 0; j < 10; ++j) {
    plant.faults.push_back({fmt::format("f{}", j), FaultKind::kComponent, VectorXd::Unit(3, j % 3),
                            VectorXd::Zero(3)});
  }
  const DesignResult result = design_bank(plant, hou_request());
  EXPECT_EQ(result.residuals.size(), 45u);
  EXPECT_EQ(result.residuals.front().name, "r1_2");
  EXPECT_EQ(result.residuals.back().name, "r9_10");
  EXPECT_FALSE(result.is_solvable);
}

TEST(DesignBank, SaysWhyAResidualDoesNotExist) {
  PlantModel plant = hou_plant();
  plant.faults.push_back({"x", FaultKind::kComponent, VectorXd::Unit(3, 0), VectorXd::Zero(3)});
  BankRequest request = hou_request();
  request.concurrent = 3;
  const DesignResult result = design_bank(plant, request);
  EXPECT_FALSE(result.is_solvable);
  EXPECT_FALSE(result.residuals.front().exists);
  EXPECT_NE(result.residuals.front().reason, "");
}

TEST(DesignBank, NeverGivesABankWhoseNumbersOverflow) {
  for (const double huge : {1e150, 1e300}) {
    PlantModel plant = hou_plant();
    plant.B(1, 0) = huge;
    plant.faults[0].state(1) = huge;
    const DesignResult result = design_bank(plant, hou_request());
    for (const ResidualFilter& filter : result.bank.filters) {
      EXPECT_TRUE(filter.F.allFinite() && filter.E.allFinite() && filter.G.allFinite());
      EXPECT_TRUE(filter.M.allFinite() && filter.H.allFinite() && filter.K.allFinite());
    }
    EXPECT_EQ(parse_bank(bank_text(result.bank), "bank").filters.size(),
              result.bank.filters.size());
  }
}

TEST(DesignBank, RefusesAtTheirPlaceInTheRequest) {
  struct Case {
    std::string from, to, message;
  };
  const std::vector<Case> cases = {
      {"poles         = [-10.0]", "poles = [1.0]",
       "bank.toml:6:9: poles: found 1+0i, expected neg"},
      {"poles         = [-10.0]", "poles = []", "bank.toml:6:9: poles: found no pole"},
      {"poles         = [-10.0]", "poles = [[-3, 4]]", "bank.toml:6:9: poles: found -3+4i alone"},
      {"poles         = [-10.0]", "poles = [[-3, 4], [-3, -4]]",
       "bank.toml:6:9: poles: residual r12 has order 1, and the first 1 poles split"},
      {"poles         = [-10.0]", "domain = \"sampled\"\npoles = [-10.0]",
       "bank.toml:7:9: poles: found -10+0i, expected poles inside the unit circle"},
      {"concurrent    = 2", "concurrent = 4", "bank.toml:5:14: concurrent: found 4"},
      {"normalise     = true", "decouple = [\"d\"]", "bank.toml:8:12: decouple: found \"d\""},
  };
  for (const Case& entry : cases) {
    std::string text = hou_request_text(true, 3);
    text.replace(text.find(entry.from), entry.from.size(), entry.to);
    EXPECT_THAT(refusal(hou_plant(), parse_bank_request(text, "bank.toml")),
                StartsWith(entry.message));
  }
}

TEST(DesignBank, RefusesPlantsItCannotUse) {
  PlantModel plant = hou_plant();
  plant.faults.clear();
  EXPECT_THAT(refusal(plant, hou_request()), HasSubstr("without faults"));
  plant = hou_plant();
  plant.time = TimeDomain::kDiscrete;
  plant.sample_time_s = 0.01;
  EXPECT_THAT(refusal(plant, hou_request()), HasSubstr("expected \"sampled\""));
}

TEST(DesignBank, SaysHowManyPolesAResidualOfLargerOrderNeeds) {
  const OracleCase generic = oracle_cases()[1];  // order 5, 3 rows
  BankRequest request = generic.request();
  request.poles = {-1.0};
  EXPECT_THAT(refusal(generic.plant(), request),
              AllOf(HasSubstr("residual r1 has order 5"), HasSubstr("at least 2 different poles")));
  request.poles = {-1.0, -2.0};
  EXPECT_THAT(refusal(generic.plant(), request), HasSubstr("found 2 poles, expected 5"));
}

TEST(DesignBank, DecouplesAConstantOffsetAsTheOracleSays) {
  for (const char* const name : {"e1", "e2", "e3"}) {
    PlantModel plant = hou_plant();
    plant.disturbances.push_back(
        {"offset", VectorXd::Zero(3), VectorXd::Unit(3, name[1] - '1'), {}});
    for (const std::size_t p : {1u, 2u}) {
      BankRequest request = hou_request();
      request.concurrent = p;
      request.decouple_constant = {"offset"};
      request.poles = {-10.0, -11.0, -12.0};
      const DesignResult result = design_bank(plant, request);
      EXPECT_TRUE(result.is_solvable);
      EXPECT_EQ(result.bank.disturbances[0].treatment, BankDisturbance::Treatment::kConstant);
      for (const OracleConstantBias& expected : oracle_constant_bias(name)) {
        if (expected.ignores.size() != p) {
          continue;
        }
        const auto report =
            std::find_if(result.residuals.begin(), result.residuals.end(),
                         [&](const auto& entry) { return entry.ignores == expected.ignores; });
        ASSERT_NE(report, result.residuals.end());
        SCOPED_TRACE(report->name);
        EXPECT_EQ(report->dim_s, expected.dim_s);
        for (std::size_t j = 0; j < 4; ++j) {
          const bool is_seen =
              std::count(expected.responds.begin(), expected.responds.end(), j) > 0;
          const Sensitivity sensitivity = !is_seen             ? Sensitivity::kNone
                                          : expected.has_dc[j] ? Sensitivity::kSteady
                                                               : Sensitivity::kTransient;
          EXPECT_EQ(report->sees[j], sensitivity) << "fault " << j;
        }
        // A constant offset leaves the settled residual: v = F v - E d, r = M v - H d.
        const ResidualFilter* filter = find_filter(result.bank, report->name);
        const VectorXd d = plant.disturbances[0].output;
        const MatrixXd I = MatrixXd::Identity(filter->F.rows(), filter->F.rows());
        const VectorXd v = (I - filter->F).lu().solve(-filter->E * d);
        EXPECT_LT((filter->M * v - filter->H * d).norm(), 1e-10);
      }
    }
  }
}

TEST(DesignBank, DecaysAtLeastAsFastAsAsked) {
  for (const OracleCase& oracle : oracle_cases()) {
    for (const double rate : {0.5, 10.0}) {
      SCOPED_TRACE(fmt::format("{} at {}", oracle.name, rate));
      BankRequest request = oracle.request();
      request.poles.clear();
      request.decay_rate_per_s = rate;
      for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
        request.domain = domain;
        const DesignResult result = design_bank(oracle.plant(), request);
        EXPECT_FALSE(result.bank.filters.empty());
        // Sampled, b_3 = A b_1 of h6 is no longer hidden behind b_1.
        EXPECT_TRUE(result.is_solvable == oracle.is_solvable || domain == DesignDomain::kSampled);
        for (const ResidualFilter& filter : result.bank.filters) {
          EXPECT_LE(spectral_radius(filter.F), std::exp(-rate * 0.01) + 1e-9);
        }
      }
    }
  }
}

TEST(DesignBank, SaysWhichSetsFailAndWhy) {
  const auto reasons = [](const DesignResult& result) {
    std::vector<std::string> found;
    for (const DesignFailure& failure : result.failing) {
      found.push_back(failure.reason);
    }
    return found;
  };
  // h4: b_3 = b_1 + b_2.
  const OracleCase dependent = oracle_cases()[2];
  for (const std::string& reason : reasons(design_bank(dependent.plant(), dependent.request()))) {
    EXPECT_THAT(reason, HasSubstr("(Corollary 1: rank 2, 3 needed)"));
  }
  // h6: b_3 = A b_1 with C b_1 = 0; Corollary 1 holds.
  const OracleCase hidden = oracle_cases()[3];
  for (const std::string& reason : reasons(design_bank(hidden.plant(), hidden.request()))) {
    EXPECT_THAT(reason, AllOf(HasSubstr("lies in S*"), HasSubstr("Corollary 1 holds")));
  }
  // As many outputs as faults to ignore.
  PlantModel plant = hou_plant();
  plant.C.row(2).setZero();
  DesignResult result = design_bank(plant, hou_request());
  EXPECT_THAT(result.residuals[0].reason,
              AllOf(HasSubstr("rank C W* = rank C = 2"),
                    HasSubstr("2 independent outputs cannot do without 2 faults")));
  // A disturbance that takes the last output.
  plant = hou_plant();
  plant.disturbances.push_back({"d", VectorXd::Zero(3), VectorXd::Unit(3, 1), {}});
  BankRequest request = hou_request();
  request.decouple = {"d"};
  result = design_bank(plant, request);
  EXPECT_FALSE(result.is_solvable);
  EXPECT_THAT(result.residuals[0].reason,
              HasSubstr("the decoupled disturbance takes the outputs it needs"));
  // A fault that reaches nothing.
  plant = hou_plant();
  plant.faults.push_back({"none", FaultKind::kComponent, VectorXd::Zero(3), VectorXd::Zero(3)});
  EXPECT_EQ(reasons(design_bank(plant, hou_request()))[0], "it reaches no output");
}

TEST(DesignBank, ReportsHowFarItsRanksAreFromFlipping) {
  for (const OracleCase& oracle : oracle_cases()) {
    for (const ResidualReport& report : design_bank(oracle.plant(), oracle.request()).residuals) {
      SCOPED_TRACE(oracle.name + " " + report.name);
      EXPECT_GT(report.rank_margin.smallest_kept, 1e-6);
      EXPECT_LT(report.rank_margin.largest_dropped, 1e-12);
      EXPECT_EQ(report.stability.tolerance_min, 1e-12);
      EXPECT_EQ(report.stability.tolerance_max, 1e-6);
    }
  }
  // Hou's b_1 = (1, 0, 0) moved by 2e-9 off the plane of b_2 and b_3 in r23 is a close call.
  PlantModel plant = hou_plant();
  plant.faults[0].state = plant.B.col(1) + 2e-9 * VectorXd::Unit(3, 0);
  const DesignResult result = design_bank(plant, hou_request());
  const ResidualReport& r12 = result.residuals[0];
  EXPECT_LT(r12.rank_margin.smallest_kept, 1e-7);
  EXPECT_LT(r12.stability.tolerance_max, 1e-6);
}

TEST(DesignBank, GivesTheSameBankInOtherUnitsOfStateAndOutput) {
  for (const OracleCase& oracle : oracle_cases()) {
    SCOPED_TRACE(oracle.name);
    const PlantModel plant = oracle.plant();
    PlantModel scaled = plant;
    const VectorXd t = VectorXd::NullaryExpr(
        plant.n(), [](Index i) { return std::pow(10.0, i % 2 == 0 ? 4.0 : -4.0); });
    const VectorXd s = VectorXd::NullaryExpr(
        plant.q(), [](Index i) { return std::pow(10.0, i % 2 == 0 ? -3.0 : 3.0); });
    scaled.A = t.asDiagonal() * plant.A * t.cwiseInverse().asDiagonal();
    scaled.B = t.asDiagonal() * plant.B;
    scaled.C = s.asDiagonal() * plant.C * t.cwiseInverse().asDiagonal();
    for (std::size_t j = 0; j < plant.faults.size(); ++j) {
      scaled.faults[j].state = t.asDiagonal() * plant.faults[j].state;
    }
    for (std::size_t j = 0; j < plant.disturbances.size(); ++j) {
      scaled.disturbances[j].output = s.asDiagonal() * plant.disturbances[j].output;
    }
    const DesignResult a = design_bank(plant, oracle.request());
    const DesignResult b = design_bank(scaled, oracle.request());
    EXPECT_EQ(a.is_solvable, b.is_solvable);
    ASSERT_EQ(a.residuals.size(), b.residuals.size());
    for (std::size_t i = 0; i < a.residuals.size(); ++i) {
      EXPECT_EQ(a.residuals[i].dim_w, b.residuals[i].dim_w);
      EXPECT_EQ(a.residuals[i].dim_s, b.residuals[i].dim_s);
      EXPECT_EQ(a.residuals[i].sees, b.residuals[i].sees);
      EXPECT_EQ(b.residuals[i].stability.tolerance_max, 1e-6);
    }
    SampledRun run(scaled, b.bank);
    for (const ResidualFilter& filter : b.bank.filters) {
      EXPECT_LT(run.largest_residual(filter, VectorXd::Zero(std::ssize(plant.faults)), 0, 50), 1e-3)
          << filter.name;
    }
  }
}

}  // namespace
}  // namespace faultline

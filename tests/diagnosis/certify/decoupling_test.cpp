#include "diagnosis/certify/decoupling.h"

#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/discretize.h"
#include "tests/diagnosis/certify/certify_cases.h"
#include "tests/diagnosis/geometric_oracle.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Treatment = BankDisturbance::Treatment;

// What of a bank the geometry depends on.
Bank bank_frame(const PlantModel& plant, Treatment treatment,
                DesignDomain domain = DesignDomain::kContinuous) {
  Bank bank;
  bank.domain = domain;
  bank.sample_time_s = 0.01;
  for (const Disturbance& disturbance : plant.disturbances) {
    bank.disturbances.push_back({disturbance.name, treatment});
  }
  return bank;
}

void scale_states(PlantModel& plant, const VectorXd& scales) {
  const VectorXd inverse = scales.cwiseInverse();
  plant.A = (scales.asDiagonal() * plant.A * inverse.asDiagonal()).eval();
  plant.B = (scales.asDiagonal() * plant.B).eval();
  plant.C = (plant.C * inverse.asDiagonal()).eval();
  for (Fault& fault : plant.faults) {
    fault.state = fault.state.cwiseProduct(scales).eval();
  }
}

TEST(DecouplingAnalysis, AgreesWithTheOracleOnAllCases) {
  for (const OracleCase& oracle : oracle_cases()) {
    SCOPED_TRACE(oracle.name);
    const PlantModel plant = oracle.plant();
    const DecouplingAnalysis analysis(plant, bank_frame(plant, Treatment::kDecoupled));
    for (const OracleResidual& expected : oracle.residuals) {
      const Decoupling found = analysis.of(expected.ignores);
      EXPECT_EQ(found.rank.dim_w, expected.dim_w);
      EXPECT_EQ(found.rank.dim_s, expected.dim_s);
      ASSERT_EQ(found.margin.size(), expected.margin.size());
      for (std::size_t j = 0; j < expected.margin.size(); ++j) {
        EXPECT_NEAR(found.margin[j], expected.margin[j], 1e-9);
      }
      EXPECT_EQ(found.rank.tolerance_min, 1e-12);
      EXPECT_EQ(found.rank.tolerance_max, 1e-6);
    }
  }
}

/// A fault's column of the state equation in the domain of the design.
VectorXd direction(const PlantModel& plant, const BankRequest& request, std::size_t j) {
  const VectorXd& state = plant.faults[j].state;
  return request.domain == DesignDomain::kSampled
             ? VectorXd(discretize_zoh(plant.A, state, request.sample_time_s).B)
             : state;
}

TEST(DecouplingAnalysis, AgreesWithTheDesignOnFaultsAndDisturbancesThatReachTheOutput) {
  for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
    for (std::uint64_t seed = 10; seed < 15; ++seed) {
      SCOPED_TRACE(seed_message(test_seed(seed)));
      CertifyCase random = random_case(test_seed(seed), 6, 2, 5, 1, domain);
      PlantModel& plant = random.plant;
      plant.faults.push_back({"y2", FaultKind::kSensor, VectorXd::Zero(6), VectorXd::Unit(5, 1)});
      plant.faults.push_back({"leak", FaultKind::kComponent, 0.3 * VectorXd::Unit(6, 2),
                              VectorXd::LinSpaced(5, -1.0, 2.0)});
      plant.disturbances.push_back(
          {"d", VectorXd::Unit(6, 4), 0.5 * VectorXd::Unit(5, 3), std::nullopt});
      random.request.decouple = {"d"};
      const DesignResult design = design_bank(plant, random.request);
      const DecouplingAnalysis analysis(plant, design.bank);
      for (const ResidualReport& report : design.residuals) {
        const Decoupling found = analysis.of(report.ignores);
        EXPECT_EQ(found.rank.dim_w, report.dim_w);
        EXPECT_EQ(found.rank.dim_s, report.dim_s);
        ASSERT_EQ(found.margin.size(), report.margin.size());
        for (std::size_t j = 0; j < report.margin.size(); ++j) {
          SCOPED_TRACE(fmt::format("{} fault {}", report.name, j));
          // The design decides in units of its own: what counts is what is zero.
          EXPECT_EQ(found.margin[j] > 1e-9, report.margin[j] > 1e-9);
          if (plant.faults[j].output.isZero(0.0)) {
            const VectorXd b = direction(plant, random.request, j);
            EXPECT_NEAR(found.margin[j], (b - report.projector_s * b).norm() / b.norm(), 1e-9);
          }
        }
      }
    }
  }
}

TEST(DecouplingAnalysis, IsNotMisledByTheUnitsOfTheStates) {
  for (const OracleCase& oracle : oracle_cases()) {
    SCOPED_TRACE(oracle.name);
    PlantModel plant = oracle.plant();
    VectorXd scales(plant.n());
    for (Index i = 0; i < scales.size(); ++i) {
      scales[i] = i % 3 == 0 ? 1e4 : i % 3 == 1 ? 1.0 : 1e-4;
    }
    scale_states(plant, scales);
    const DecouplingAnalysis analysis(plant, bank_frame(plant, Treatment::kDecoupled));
    for (const OracleResidual& expected : oracle.residuals) {
      const Decoupling found = analysis.of(expected.ignores);
      EXPECT_EQ(found.rank.dim_w, expected.dim_w);
      EXPECT_EQ(found.rank.dim_s, expected.dim_s);
      for (std::size_t j = 0; j < plant.faults.size(); ++j) {
        const VectorXd& b = plant.faults[j].state;
        const VectorXd unit = scales.cwiseInverse().cwiseProduct(b);
        const bool is_inside = (unit - expected.projector_s * unit).norm() < 1e-8 * unit.norm();
        EXPECT_EQ(found.margin[j] < 1e-9, is_inside) << "fault " << j;
      }
    }
  }
}

TEST(DecouplingAnalysis, MeasuresMarginsInThePlantsOwnCoordinates) {
  // S* is the line of b1; b2 stands at the same angle to it as (1, 1000) to (0, 1000).
  PlantModel plant =
      plant_of(-MatrixXd::Identity(2, 2), (MatrixXd(2, 2) << 0.0, 1.0, 1000.0, 1000.0).finished(),
               MatrixXd::Identity(2, 2));
  const Decoupling found = DecouplingAnalysis(plant, bank_frame(plant, Treatment::kNone)).of({0});
  EXPECT_EQ(found.rank.dim_s, 1u);
  EXPECT_NEAR(found.margin[0], 0.0, 1e-15);
  EXPECT_NEAR(found.margin[1], 1.0 / std::hypot(1.0, 1000.0), 1e-12);
}

TEST(DecouplingAnalysis, TakesAConstantDisturbanceAsAStateOfItsOwn) {
  for (Index e = 0; e < 3; ++e) {
    PlantModel plant = hou_plant();
    plant.disturbances.push_back({"d", VectorXd::Zero(3), VectorXd::Unit(3, e), std::nullopt});
    for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
      const DecouplingAnalysis analysis(plant, bank_frame(plant, Treatment::kConstant, domain));
      for (const OracleConstantBias& expected : oracle_constant_bias(fmt::format("e{}", e + 1))) {
        SCOPED_TRACE(fmt::format("e{}, ignores {}", e + 1, fmt::join(expected.ignores, ", ")));
        const Decoupling found = analysis.of(expected.ignores);
        if (domain == DesignDomain::kContinuous) {
          EXPECT_EQ(found.rank.dim_s, expected.dim_s);
        }
        for (std::size_t j = 0; j < 4; ++j) {
          const bool is_seen = std::count(expected.responds.begin(), expected.responds.end(), j);
          EXPECT_EQ(found.margin[j] > 1e-9, is_seen) << "fault " << j;
        }
      }
    }
  }
}

TEST(DecouplingAnalysis, SaysForWhichTolerancesItsDimensionsStand) {
  // The third direction is A times the first, which no output shows; 1e-10 off, that is no longer
  // so, and tolerances below say so.
  const OracleCase h6 = oracle_cases()[3];
  PlantModel plant = h6.plant();
  const std::vector<std::size_t> first = {0};
  const RankCertificate exact =
      DecouplingAnalysis(plant, bank_frame(plant, Treatment::kNone)).of(first).rank;
  plant.A += 1e-10 * MatrixXd::Ones(6, 6);
  plant.C += 1e-10 * MatrixXd::Ones(4, 6);
  const RankCertificate near =
      DecouplingAnalysis(plant, bank_frame(plant, Treatment::kNone)).of(first).rank;
  EXPECT_EQ(near.dim_w, exact.dim_w);
  EXPECT_EQ(near.dim_s, exact.dim_s);
  EXPECT_GT(near.largest_dropped, 1e-12);
  EXPECT_LT(near.largest_dropped, 1e-9);
  EXPECT_GT(near.tolerance_min, 1e-12);
  EXPECT_LE(near.tolerance_min, 1e-9);
  EXPECT_EQ(near.tolerance_max, 1e-6);
}

TEST(DecouplingAnalysis, OfEverythingIgnoredLeavesNothing) {
  const PlantModel plant =
      plant_of(-MatrixXd::Identity(2, 2), MatrixXd::Identity(2, 2), MatrixXd::Identity(2, 2));
  const Decoupling found =
      DecouplingAnalysis(plant, bank_frame(plant, Treatment::kNone)).of({0, 1});
  EXPECT_EQ(found.rank.dim_s, 2u);
  EXPECT_EQ(found.margin, (std::vector<double>{0.0, 0.0}));
}

}  // namespace
}  // namespace faultline

// Statements of Hou, Cheng, Hu, Jin, Acta Automatica Sinica 41 (2015) 1113-1122 that do not hold as
// printed, each beside what does.
#include <algorithm>
#include <cmath>
#include <complex>
#include <fstream>
#include <string>
#include <vector>

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "diagnosis/design/design_bank.h"
#include "diagnosis/design/geometric.h"
#include "diagnosis/design/pole_placement.h"
#include "tests/diagnosis/design/reference_geometry.h"
#include "tests/diagnosis/geometric_oracle.h"
#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXcd;
using Eigen::VectorXd;

const OracleCase& named(const std::vector<OracleCase>& cases, const std::string& prefix) {
  return *std::find_if(cases.begin(), cases.end(),
                       [&](const OracleCase& oracle) { return oracle.name.starts_with(prefix); });
}

Index rank(const MatrixXd& X) { return Eigen::ColPivHouseholderQR<MatrixXd>(X).rank(); }

/// Every pair of columns of B, for Hou's plant.
std::vector<MatrixXd> pairs_of(const MatrixXd& B) {
  std::vector<MatrixXd> pairs;
  for (Index i = 0; i < B.cols(); ++i) {
    for (Index j = i + 1; j < B.cols(); ++j) {
      pairs.emplace_back(B.rows(), 2);
      pairs.back() << B.col(i), B.col(j);
    }
  }
  return pairs;
}

// Remark 1: "w in R^n, full order". The order is n - dim S*, in the paper's own example 1.
TEST(HouStatements, AFilterHasTheOrderOfTheQuotientNotOfThePlant) {
  for (const ResidualFilter& filter : hou_bank().filters) {
    EXPECT_EQ(filter.F.rows(), 1) << filter.name;
  }
  const OracleCase generic = oracle_cases()[1];
  for (const ResidualReport& report : design_bank(generic.plant(), generic.request()).residuals) {
    EXPECT_EQ(report.quotient_dim, generic.A.rows() - report.dim_s);
    EXPECT_LT(report.quotient_dim, generic.A.rows());
  }
}

// Step 4: "D = D_0 + P^-T D_1 H". P is no square matrix; what it takes is a right inverse of P:
// with it, A + D C induces F on the quotient.
TEST(HouStatements, TheGainComesThroughARightInverseOfP) {
  const OracleCase generic = oracle_cases()[1];
  const Index q = generic.C.rows();
  const MatrixXd B = generic.B;
  const GeometricQuotient quotient =
      geometric_quotient(generic.A, generic.C, {B.leftCols(1), MatrixXd::Zero(q, 1)},
                         {B, MatrixXd::Zero(q, B.cols())});
  const std::vector<std::complex<double>> poles(generic.poles.begin(),
                                                generic.poles.begin() + quotient.P.rows());
  const PolePlacement placement = place_poles(quotient.A_0, quotient.M, poles);
  ASSERT_TRUE(placement.is_possible);
  const GeometricFilter filter = complete_filter(quotient, placement);
  ASSERT_LT(quotient.P.rows(), quotient.P.cols());
  // Any right inverse will do: the pseudo-inverse, and another one.
  const MatrixXd P_right = quotient.P.completeOrthogonalDecomposition().pseudoInverse();
  const MatrixXd other =
      P_right + (MatrixXd::Identity(P_right.rows(), P_right.rows()) - P_right * quotient.P) *
                    MatrixXd::Ones(P_right.rows(), P_right.cols());
  for (const MatrixXd& right : {P_right, other}) {
    EXPECT_LT(
        (quotient.P * right - MatrixXd::Identity(quotient.P.rows(), quotient.P.rows())).norm(),
        1e-12);
    const MatrixXd D = right * filter.E;
    EXPECT_LT((quotient.P * (generic.A + D * generic.C) - filter.F * quotient.P).norm(),
              1e-10 * (1.0 + filter.E.norm() * generic.C.norm()));
  }
}

// Corollary 1: rank [L_Ω L_j] = p + 1 for all Ω, j makes the problem solvable. It is necessary;
// with Ker C ≠ 0 it is not sufficient.
TEST(HouStatements, TheRankOfTheDirectionsIsNecessaryButNotSufficient) {
  const std::vector<OracleCase> cases = oracle_cases();
  const OracleCase& counterexample = named(cases, "h6");
  ASSERT_EQ(counterexample.concurrent, 1u);
  for (const MatrixXd& pair : pairs_of(counterexample.B)) {
    EXPECT_EQ(rank(pair), 2);
  }
  EXPECT_LT(rank(counterexample.C), counterexample.A.rows());
  EXPECT_FALSE(design_bank(counterexample.plant(), counterexample.request()).is_solvable);
  // Where it fails: b_3 = A b_1 with C b_1 = 0 lies in W* of b_1.
  EXPECT_LT((counterexample.C * counterexample.B.col(0)).norm(), 1e-12);
  EXPECT_LT((counterexample.A * counterexample.B.col(0) - counterexample.B.col(2)).norm(), 1e-12);
  // Necessary: h4 breaks it and is not solvable.
  const OracleCase& dependent = named(cases, "h4");
  EXPECT_EQ(rank(dependent.B.leftCols(3)), 2);
  EXPECT_FALSE(design_bank(dependent.plant(), dependent.request()).is_solvable);
  // Sufficient when every state is measured, as in the paper's example.
  EXPECT_EQ(rank(cases.front().C), 3);
  EXPECT_TRUE(design_bank(hou_plant(), hou_request()).is_solvable);
}

// Theorem 2: p concurrent faults are detected and isolated. For generic signals only: (2, 1)·g on
// actuators 1 and 2 and (1, 1)·g on 3 and 4 are the same input for every g.
TEST(HouStatements, TwoPairsOfFaultsCanLookTheSameForAllTime) {
  const PlantModel plant = hou_plant();
  EXPECT_LT((plant.B * Eigen::Vector4d(2, 1, -1, -1)).norm(), 1e-15);
  // In the sampled domain, where a bank's response to held faults is exact.
  BankRequest request = hou_request();
  request.domain = DesignDomain::kSampled;
  request.poles = {std::exp(-0.1)};
  const Bank bank = design_bank(plant, request).bank;
  // Steady residuals of the two, and no pair has their common signature.
  std::vector<bool> both;
  for (const ResidualFilter& filter : bank.filters) {
    const MatrixXd I = MatrixXd::Identity(filter.F.rows(), filter.F.rows());
    const MatrixXd gain = filter.M * (I - filter.F).lu().solve(filter.L) + filter.J;
    const VectorXd first = gain * Eigen::Vector4d(2, 1, 0, 0);
    const VectorXd second = gain * Eigen::Vector4d(0, 0, 1, 1);
    EXPECT_LT((first - second).norm(), 1e-12 * (1.0 + first.norm())) << filter.name;
    both.push_back(first.norm() > 1e-9);
  }
  EXPECT_EQ(both, (std::vector<bool>{false, true, true, true, true, false}));
  EXPECT_TRUE(design_bank(plant, hou_request()).are_signatures_distinct);
  // Isolable for all signals takes 2p independent columns; three outputs cannot have four.
  const Directions all = reference::fault_directions(plant, reference::all_faults(plant));
  EXPECT_EQ(reference::rank(reference::transfer(plant, all, {2.0, 3.0})), 3);
  for (const std::vector<std::size_t>& three :
       {std::vector<std::size_t>{0, 1, 2}, {0, 1, 3}, {0, 2, 3}, {1, 2, 3}}) {
    EXPECT_EQ(reference::rank(reference::transfer(plant, reference::fault_directions(plant, three),
                                                  {2.0, 3.0})),
              3);
  }
}

// Section 3: "E_i D_f = 0 and H_i D_f = 0 ... completely decoupled" for all six residuals. Each has
// one such direction, no two the same: a disturbance can be had out of one residual at most.
TEST(HouStatements, AnOutputDisturbanceLeavesAtMostOneOfTheSixResiduals) {
  const PlantModel plant = hou_plant();
  const std::vector<Vector3d> expected = {{2, 2, 9},  {1, 0, 0},  {0, 0, 1},
                                          {8, 5, 13}, {-6, 1, 9}, {-2, 1, 1}};
  std::vector<VectorXd> directions;
  for (const MatrixXd& pair : pairs_of(plant.B)) {
    const GeometricQuotient quotient = geometric_quotient(
        plant.A, plant.C, {pair, MatrixXd::Zero(3, 2)}, {plant.B, MatrixXd::Zero(3, 4)});
    const GeometricFilter filter =
        complete_filter(quotient, place_poles(quotient.A_0, quotient.M, {-10.0}));
    MatrixXd seen(quotient.H.rows() + filter.E.rows(), 3);
    seen << filter.E, quotient.H;
    const Eigen::FullPivLU<MatrixXd> lu(seen);
    ASSERT_EQ(lu.dimensionOfKernel(), 1);
    directions.emplace_back(lu.kernel().col(0).normalized());
    const Vector3d& printed = expected[directions.size() - 1];
    EXPECT_NEAR(std::abs(directions.back().dot(printed)) / printed.norm(), 1.0, 1e-12);
  }
  for (std::size_t i = 0; i < directions.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      EXPECT_LT(std::abs(directions[i].dot(directions[j])), 1.0 - 1e-3) << i << " and " << j;
    }
  }
}

// Equation (7) takes an output disturbance for two independent state directions, f and A f with
// C f = D_f. That is sufficient, and far from necessary.
TEST(HouStatements, TwoStateDirectionsForAnOutputDisturbanceIgnoreMoreThanTheyNeed) {
  std::ifstream in(FAULTLINE_GOLDEN_DIR "/geometric/hou_reference.json");
  const nlohmann::json golden = nlohmann::json::parse(in).at("disturbance");
  const PlantModel plant = hou_plant();
  int compared = 0;
  for (Index e = 0; e < 3; ++e) {
    const VectorXd D_f = VectorXd::Unit(3, e);
    const VectorXd f = plant.C.lu().solve(D_f);
    for (const nlohmann::json& entry : golden.at("e" + std::to_string(e + 1)).at("eq7")) {
      const auto decouple = entry.at("decouple").get<std::vector<Index>>();
      MatrixXd L(3, std::ssize(decouple) + 2);
      MatrixXd outputs = MatrixXd::Zero(3, std::ssize(decouple) + 1);
      for (Index i = 0; i < std::ssize(decouple); ++i) {
        L.col(i) = plant.B.col(decouple[static_cast<std::size_t>(i)] - 1);
      }
      L.rightCols(2) << f, plant.A * f;
      SubspaceArithmetic arithmetic;
      const MatrixXd S = unobservability_subspaces(plant.A, plant.C, L, arithmetic).S;
      EXPECT_EQ(S.cols(), entry.at("dimS").get<Index>());
      for (Index j = 0; j < 4; ++j) {
        const auto responds = entry.at("responds").get<std::vector<Index>>();
        const bool is_seen = reference::outside(S, plant.B.col(j)) > 1e-9;
        EXPECT_EQ(is_seen, std::count(responds.begin(), responds.end(), j + 1) > 0);
      }
      // What ignores f and A f ignores the disturbance, so the exact S* is no larger.
      MatrixXd states = MatrixXd::Zero(3, outputs.cols());
      states.leftCols(std::ssize(decouple)) = L.leftCols(std::ssize(decouple));
      outputs.rightCols(1) = D_f;
      const GeometricQuotient exact =
          geometric_quotient(plant.A, plant.C, {states, outputs}, {plant.B, MatrixXd::Zero(3, 4)});
      EXPECT_LE(exact.dim_s, S.cols());
      ++compared;
    }
  }
  EXPECT_EQ(compared, 33);
}

// With exact projection the same disturbances leave: e2 all single faults, e1 and e3 two groups.
TEST(HouStatements, SingleFaultsAreIsolableBesideTheSecondOutputDisturbanceOnly) {
  for (Index e = 0; e < 3; ++e) {
    PlantModel plant = hou_plant();
    plant.disturbances.push_back({"d", VectorXd::Zero(3), VectorXd::Unit(3, e), {}});
    BankRequest request = hou_request();
    request.concurrent = 1;
    request.decouple = {"d"};
    request.poles = {-10.0, -11.0};
    const DesignResult result = design_bank(plant, request);
    EXPECT_EQ(result.is_solvable, e == 1) << "e" << e + 1;
    EXPECT_EQ(result.are_signatures_distinct, e == 1) << "e" << e + 1;
    // Two faults that cannot be told: dependent beside the disturbance.
    const Directions d = reference::disturbance_directions(plant);
    const std::vector<std::size_t> group =
        e == 2 ? std::vector<std::size_t>{0, 3} : std::vector<std::size_t>{0, 2};
    const Index together = reference::rank(reference::transfer(
        plant, reference::side_by_side(d, reference::fault_directions(plant, group)), {2.0, 3.0}));
    EXPECT_EQ(together, e == 1 ? 3 : 2) << "e" << e + 1;
  }
}

}  // namespace
}  // namespace faultline

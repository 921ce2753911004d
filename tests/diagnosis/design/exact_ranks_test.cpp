// Plants of whole numbers: every rank of the design against exact arithmetic.
#include <algorithm>
#include <vector>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "diagnosis/design/design_bank.h"
#include "diagnosis/design/geometric.h"
#include "tests/diagnosis/design/rapidcheck_plants.h"
#include "tests/diagnosis/design/reference_geometry.h"
#include "tests/support/exact_arithmetic.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

const std::vector<PlantKind> kStateFaults = {PlantKind::kWholeNumbers, PlantKind::kWholeZeros};
const std::vector<PlantKind> kWhole = {PlantKind::kWholeNumbers, PlantKind::kWholeZeros,
                                       PlantKind::kWholeMixed, PlantKind::kWholeDisturbances};

// No eigenvalue of matrices of small whole numbers, but with a probability of 1e-17.
constexpr std::uint64_t kSomewhere = 1'152'921'504'606'846'883;

/// What exact arithmetic says of the residual that ignores `ignored`.
struct ExactAnswer {
  Index dim_w = 0, dim_s = 0, rows = 0;
  std::vector<bool> sees;
};

ExactMatrix transfer(const PlantModel& plant, const Directions& directions) {
  return exact_transfer(ExactMatrix(plant.A), ExactMatrix(directions.state), ExactMatrix(plant.C),
                        ExactMatrix(directions.output), kSomewhere);
}

ExactAnswer exact_answer(const PlantModel& plant, const Directions& ignored) {
  const Index n = plant.n();
  const Index count = ignored.state.cols();
  // Each ignored signal becomes a state: x_e = (x, m).
  MatrixXd A = MatrixXd::Zero(n + count, n + count);
  A.topLeftCorner(n, n) = plant.A;
  A.topRightCorner(n, count) = ignored.state;
  MatrixXd C(plant.q(), n + count);
  C << plant.C, ignored.output;
  MatrixXd L = MatrixXd::Zero(n + count, count);
  L.bottomRows(count).setIdentity();
  const ExactSubspaces spaces =
      exact_unobservability_subspaces(ExactMatrix(A), ExactMatrix(C), ExactMatrix(L));
  const Directions faults = reference::fault_directions(plant, reference::all_faults(plant));
  MatrixXd reached(plant.q(), n + faults.output.cols() + count);
  reached << plant.C, faults.output, ignored.output;
  ExactAnswer answer;
  answer.dim_w = spaces.W.cols() - count;
  answer.dim_s = spaces.S.cols() - count;
  const Index taken = rank(transfer(plant, ignored));
  answer.rows = rank(ExactMatrix(reached)) - taken;
  for (std::size_t j = 0; j < plant.faults.size(); ++j) {
    const Directions both =
        reference::side_by_side(ignored, reference::fault_directions(plant, {j}));
    answer.sees.push_back(rank(transfer(plant, both)) > taken);
  }
  return answer;
}

BankRequest request_for(const PlantModel& plant, std::size_t concurrent) {
  BankRequest request;
  request.name = "random";
  request.concurrent = concurrent;
  request.sample_time_s = 0.01;
  request.threshold = 0.5;
  for (int i = 0; i < 12; ++i) {
    request.poles.emplace_back(-1.0 - 0.75 * i);
  }
  for (const Disturbance& disturbance : plant.disturbances) {
    request.decouple.push_back(disturbance.name);
  }
  return request;
}

RC_GTEST_PROP(ExactRanks, AreTheDimensionsOfWAndS, ()) {
  const PlantRecipe recipe = *recipes(kStateFaults, 12);
  const PlantModel plant = random_plant(recipe);
  const MatrixXd L = plant.B.leftCols(*rc::gen::inRange<Index>(1, 4) % plant.m() + 1);
  SubspaceArithmetic arithmetic;
  const UnobservabilitySubspaces found = unobservability_subspaces(plant.A, plant.C, L, arithmetic);
  const ExactSubspaces exact =
      exact_unobservability_subspaces(ExactMatrix(plant.A), ExactMatrix(plant.C), ExactMatrix(L));
  RC_ASSERT(found.W.cols() == exact.W.cols());
  RC_ASSERT(found.S.cols() == exact.S.cols());
}

// Few outputs make long chains: errors of one step of S* enter the next, up to n/q times.
RC_GTEST_PROP(ExactRanks, AreTheDimensionsOfWAndSForLongChains, ()) {
  PlantRecipe recipe{PlantKind::kWholeZeros};
  recipe.n = *rc::gen::inRange<Index>(8, 25);
  recipe.m = *rc::gen::inRange<Index>(1, 4);
  recipe.q = *rc::gen::inRange<Index>(2, 4);
  recipe.seed = *rc::gen::inRange<std::uint64_t>(0, 1000000);
  RC_LOG() << recipe << '\n';
  const PlantModel plant = random_plant(recipe);
  const GeometricQuotient found =
      geometric_quotient(plant.A, plant.C, {plant.B, MatrixXd::Zero(recipe.q, recipe.m)},
                         {plant.B, MatrixXd::Zero(recipe.q, recipe.m)});
  const ExactSubspaces exact = exact_unobservability_subspaces(
      ExactMatrix(plant.A), ExactMatrix(plant.C), ExactMatrix(plant.B));
  RC_ASSERT(found.dim_w == exact.W.cols());
  RC_ASSERT(found.dim_s == exact.S.cols());
}

// Tells which residuals exist, of what dimensions and rows, and which faults they see.
RC_GTEST_PROP(ExactRanks, AreThoseOfTheBank, ()) {
  const PlantRecipe recipe = *recipes(kWhole, 8);
  const PlantModel plant = random_plant(recipe);
  const BankRequest request =
      request_for(plant, *rc::gen::element<std::size_t>(1, 2) % (plant.faults.size() - 1) + 1);
  const DesignResult result = design_bank(plant, request);
  std::vector<std::pair<std::vector<std::size_t>, std::size_t>> failing, expected_failing;
  std::size_t filter = 0;
  for (const ResidualReport& report : result.residuals) {
    const ExactAnswer exact = exact_answer(
        plant, reference::side_by_side(reference::fault_directions(plant, report.ignores),
                                       reference::disturbance_directions(plant)));
    RC_LOG() << "residual " << report.name << '\n';
    RC_ASSERT(report.dim_w == exact.dim_w);
    RC_ASSERT(report.dim_s == exact.dim_s);
    RC_ASSERT(report.rows == exact.rows);
    RC_ASSERT(report.quotient_dim == plant.n() - exact.dim_s);
    const bool is_any_seen = std::count(exact.sees.begin(), exact.sees.end(), true) > 0;
    RC_ASSERT(report.exists == (exact.rows > 0 && is_any_seen));
    for (std::size_t j = 0; j < exact.sees.size(); ++j) {
      if (report.exists) {
        RC_ASSERT((result.bank.filters[filter].sees[j] != Sensitivity::kNone) == exact.sees[j]);
      }
      const bool is_ignored =
          std::find(report.ignores.begin(), report.ignores.end(), j) != report.ignores.end();
      if (!is_ignored && !exact.sees[j]) {
        expected_failing.emplace_back(report.ignores, j);
      }
    }
    filter += report.exists ? 1 : 0;
  }
  for (const DesignFailure& failure : result.failing) {
    failing.emplace_back(failure.ignores, failure.fault);
  }
  RC_ASSERT(failing == expected_failing);
  RC_ASSERT(result.is_solvable == failing.empty());
}

// The exact arithmetic against a case that can be done by hand: x1' = x2, y = x1.
TEST(ExactMatrix, FindsRanksKernelsAndTransfers) {
  const MatrixXd A = (MatrixXd(2, 2) << 0, 1, 0, 0).finished();
  const ExactMatrix X((MatrixXd(2, 3) << 1, -2, 3, 2, -4, 6).finished());
  EXPECT_EQ(rank(X), 1);
  EXPECT_EQ(kernel(X).cols(), 2);
  EXPECT_EQ(rank(X * kernel(X)), 0);
  // C (λI - A)⁻¹ B = 1/λ² at λ = 2: four of it are 1.
  const ExactMatrix T =
      exact_transfer(ExactMatrix(A), ExactMatrix((MatrixXd(2, 1) << 0, 1).finished()),
                     ExactMatrix((MatrixXd(1, 2) << 1, 0).finished()), ExactMatrix(1, 1), 2);
  EXPECT_EQ((ExactMatrix(MatrixXd::Constant(1, 1, 4.0)) * T).at(0, 0), 1u);
}

}  // namespace
}  // namespace faultline

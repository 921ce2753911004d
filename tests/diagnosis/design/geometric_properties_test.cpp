// W*, S* and the quotient on random systems: what the theory says of every one of them.
#include <algorithm>
#include <complex>
#include <string>
#include <vector>

#include <stdlib.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "diagnosis/design/geometric.h"
#include "diagnosis/design/pole_placement.h"
#include "tests/diagnosis/design/rapidcheck_plants.h"
#include "tests/diagnosis/design/reference_geometry.h"
#include "tests/support/eigenvalues.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Poles = std::vector<std::complex<double>>;

// The same runs each time unless FAULTLINE_TEST_SEED says otherwise. What rapidcheck prints on a
// failure (RC_PARAMS="reproduce=...") repeats that one case.
class RapidcheckSeed final : public testing::Environment {
  void SetUp() override {
    const std::string parameters = "seed=" + std::to_string(test_seed(1986)) + " max_success=500";
    ASSERT_EQ(::setenv("RC_PARAMS", parameters.c_str(), 0), 0);
  }
};
const testing::Environment* const kRapidcheckSeed =
    testing::AddGlobalTestEnvironment(new RapidcheckSeed);

// Rounding errors, relative, of a chain of n decisions at well separated singular values.
constexpr double kRounding = 1e-9;

/// A random plant and the first of its state directions that are to be ignored.
struct Problem {
  PlantModel plant;
  MatrixXd L;
};

Problem problem_of(const PlantRecipe& recipe, Index count) {
  Problem problem{random_plant(recipe), {}};
  problem.L = problem.plant.B.leftCols(std::min(count, problem.plant.m()));
  return problem;
}

Problem any_problem(Index largest_n) {
  const PlantRecipe recipe = *recipes(largest_n);
  return problem_of(recipe, *rc::gen::inRange<Index>(1, 4));
}

UnobservabilitySubspaces subspaces(const Problem& problem) {
  SubspaceArithmetic arithmetic;
  return unobservability_subspaces(problem.plant.A, problem.plant.C, problem.L, arithmetic);
}

// What X is measured by.
double size_of(const MatrixXd& X) { return X.norm() > 0.0 ? X.norm() : 1.0; }

// Distance of A (space ∩ Ker C) from the space, relative to A.
double escape(const PlantModel& plant, const MatrixXd& space) {
  const MatrixXd unseen = space * reference::kernel(plant.C * space / size_of(plant.C));
  return reference::outside(space, plant.A * unseen, size_of(plant.A));
}

// D with (A + D C) S in S: takes from A S what leaves S.
MatrixXd output_injection(const PlantModel& plant, const MatrixXd& S) {
  const MatrixXd leaving = plant.A * S - S * (S.transpose() * plant.A * S);
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> CS;
  CS.setThreshold(kRounding);
  CS.compute(plant.C * S);
  if (CS.maxPivot() < kRounding * plant.C.norm()) {
    return MatrixXd::Zero(plant.n(), plant.q());  // the outputs do not see it
  }
  return -leaving * CS.pseudoInverse();
}

RC_GTEST_PROP(UnobservabilitySubspaces, HoldTheirDirections, ()) {
  const Problem problem = any_problem(30);
  const auto [W, S] = subspaces(problem);
  RC_ASSERT(reference::outside(W, problem.L, problem.L.norm()) < kRounding);
  RC_ASSERT(reference::outside(S, W) < kRounding);
}

RC_GTEST_PROP(UnobservabilitySubspaces, AreConditionedInvariant, ()) {
  const Problem problem = any_problem(30);
  const auto [W, S] = subspaces(problem);
  RC_ASSERT(escape(problem.plant, W) < kRounding);
  RC_ASSERT(escape(problem.plant, S) < kRounding);
}

RC_GTEST_PROP(UnobservabilitySubspaces, AreKeptByAnOutputInjection, ()) {
  const Problem problem = any_problem(30);
  const auto [W, S] = subspaces(problem);
  for (const MatrixXd& space : {W, S}) {
    if (space.cols() == 0) {
      continue;
    }
    const MatrixXd D = output_injection(problem.plant, space);
    const MatrixXd closed = problem.plant.A + D * problem.plant.C;
    RC_ASSERT(reference::outside(space, closed * space, 1.0 + closed.norm()) < kRounding);
  }
}

RC_GTEST_PROP(UnobservabilitySubspaces, SIsUnobservableThroughTheOutputsThatDoNotSeeIt, ()) {
  const Problem problem = any_problem(12);
  const MatrixXd S = subspaces(problem).S;
  const MatrixXd H =
      reference::kernel((problem.plant.C * S / size_of(problem.plant.C)).transpose()).transpose();
  const MatrixXd D = S.cols() == 0 ? MatrixXd(MatrixXd::Zero(problem.plant.n(), problem.plant.q()))
                                   : output_injection(problem.plant, S);
  const MatrixXd unobservable = reference::unobservable_subspace(
      H * problem.plant.C, problem.plant.A + D * problem.plant.C, size_of(problem.plant.C));
  RC_ASSERT(unobservable.cols() == S.cols());
  RC_ASSERT(reference::distance(unobservable, S) < 1e-6);
}

RC_GTEST_PROP(UnobservabilitySubspaces, AreTheOrthogonalComplementsOfTheirDuals, ()) {
  const Problem problem = any_problem(12);
  const auto [W, S] = subspaces(problem);
  const auto dual =
      reference::dual_unobservability_subspaces(problem.plant.A, problem.plant.C, problem.L);
  RC_ASSERT(W.cols() == dual.W.cols());
  RC_ASSERT(S.cols() == dual.S.cols());
  RC_ASSERT(reference::distance(W, dual.W) < 1e-6);
  RC_ASSERT(reference::distance(S, dual.S) < 1e-6);
}

RC_GTEST_PROP(UnobservabilitySubspaces, LieInEveryOtherThatHoldsTheirDirections, ()) {
  const PlantRecipe recipe = *recipes(12);
  const Problem problem = problem_of(recipe, 1);
  const Index more = *rc::gen::inRange<Index>(1, 4);
  MatrixXd larger(problem.plant.n(), 1 + more);
  larger << problem.L, RandomNumbers(recipe.seed + 1).normal(problem.plant.n(), more);
  const auto [W, S] = subspaces(problem);
  const auto other =
      reference::dual_unobservability_subspaces(problem.plant.A, problem.plant.C, larger);
  RC_ASSERT(reference::outside(other.W, W) < 1e-6);
  RC_ASSERT(reference::outside(other.S, S) < 1e-6);
}

RC_GTEST_PROP(UnobservabilitySubspaces, DoNotDependOnOrderAndSizeOfTheDirections, ()) {
  const PlantRecipe recipe = *recipes(30);
  Problem problem = problem_of(recipe, 3);
  const auto before = subspaces(problem);
  RandomNumbers random(recipe.seed + 2);
  problem.L =
      (problem.L.rowwise().reverse() * random_scaling(problem.L.cols(), 6.0, recipe.seed + 3))
          .eval();
  const auto after = subspaces(problem);
  RC_ASSERT(reference::distance(before.W, after.W) < 1e-7);
  RC_ASSERT(reference::distance(before.S, after.S) < 1e-7);
}

RC_GTEST_PROP(UnobservabilitySubspaces, DoNotDependOnTheCoordinatesOfTheOutput, ()) {
  const PlantRecipe recipe = *recipes(20);
  Problem problem = problem_of(recipe, *rc::gen::inRange<Index>(1, 4));
  const auto before = subspaces(problem);
  const Index q = problem.plant.q();
  RandomNumbers random(recipe.seed + 4);
  const MatrixXd Q =
      random.orthogonal(q) * random_scaling(q, 1.0, recipe.seed + 5) * random.orthogonal(q);
  problem.plant.C = (Q * problem.plant.C).eval();
  const auto after = subspaces(problem);
  RC_ASSERT(reference::distance(before.W, after.W) < 1e-6);
  RC_ASSERT(reference::distance(before.S, after.S) < 1e-6);
}

RC_GTEST_PROP(UnobservabilitySubspaces, FollowAChangeOfTheCoordinatesOfTheState, ()) {
  const PlantRecipe recipe = *recipes(12);
  const Problem problem = problem_of(recipe, *rc::gen::inRange<Index>(1, 4));
  const auto before = subspaces(problem);
  const Index n = problem.plant.n();
  RandomNumbers random(recipe.seed + 6);
  const MatrixXd T =
      random.orthogonal(n) * random_scaling(n, 0.5, recipe.seed + 7) * random.orthogonal(n);
  Problem moved{transformed(problem.plant, T), {}};
  moved.L = moved.plant.B.leftCols(problem.L.cols());
  const auto after = subspaces(moved);
  RC_ASSERT(before.W.cols() == after.W.cols());
  RC_ASSERT(before.S.cols() == after.S.cols());
  RC_ASSERT(reference::distance(reference::image(T * after.W), before.W) < 1e-6);
  RC_ASSERT(reference::distance(reference::image(T * after.S), before.S) < 1e-6);
}

/// A quotient for some of a random plant's faults and all its disturbances.
struct QuotientProblem {
  PlantModel plant;
  Directions ignored, visible;
  GeometricQuotient quotient;
};

QuotientProblem any_quotient(Index largest_n) {
  const PlantRecipe recipe = *recipes(largest_n);
  QuotientProblem problem{random_plant(recipe), {}, {}, {}};
  std::vector<std::size_t> faults = reference::all_faults(problem.plant);
  problem.visible = reference::fault_directions(problem.plant, faults);
  // Any faults, not just the first.
  const auto count = *rc::gen::inRange<std::size_t>(0, 3);
  std::rotate(faults.begin(),
              faults.begin() + *rc::gen::inRange<std::ptrdiff_t>(0, std::ssize(faults)),
              faults.end());
  faults.resize(std::min(count, faults.size()));
  problem.ignored = reference::side_by_side(reference::fault_directions(problem.plant, faults),
                                            reference::disturbance_directions(problem.plant));
  problem.quotient =
      geometric_quotient(problem.plant.A, problem.plant.C, problem.ignored, problem.visible);
  return problem;
}

// Away from the eigenvalues of A, which the generator keeps within about 6.
constexpr std::complex<double> kSomewhere(7.3, 2.1);

RC_GTEST_PROP(GeometricQuotient, FulfilsItsEquations, ()) {
  const QuotientProblem problem = any_quotient(30);
  const GeometricQuotient& q = problem.quotient;
  const PlantModel& plant = problem.plant;
  const double scale = 1.0 + plant.A.norm() + q.E_0.norm() * plant.C.norm();
  RC_ASSERT((q.M * q.P - q.H * plant.C).norm() < kRounding * size_of(plant.C));
  RC_ASSERT((q.A_0 * q.P - q.P * plant.A - q.E_0 * plant.C).norm() < kRounding * scale);
  const double size = 1.0 + problem.ignored.state.norm() + problem.ignored.output.norm();
  RC_ASSERT((q.P * problem.ignored.state + q.E_0 * problem.ignored.output).norm() <
            kRounding * scale * size);
  RC_ASSERT((q.H * problem.ignored.output).norm() < kRounding * size);
  RC_ASSERT(reference::image(q.P.transpose()).cols() == q.P.rows());
  RC_ASSERT(reference::image(q.H.transpose()).cols() == q.H.rows());
}

// rows H = rank [C D] - dim C S*, and dim C S* is the normal rank of what is ignored (D: outputs
// of faults and of what is ignored).
RC_GTEST_PROP(GeometricQuotient, HasARowForEveryOutputThatIsLeft, ()) {
  const QuotientProblem problem = any_quotient(12);
  MatrixXd reached(problem.plant.q(), problem.plant.n() + problem.visible.output.cols() +
                                          problem.ignored.output.cols());
  reached << problem.plant.C, problem.visible.output, problem.ignored.output;
  const Index outputs = reference::image(reached).cols();
  const Index taken =
      reference::rank(reference::transfer(problem.plant, problem.ignored, kSomewhere));
  RC_ASSERT(problem.quotient.H.rows() == outputs - taken);
}

RC_GTEST_PROP(GeometricQuotient, IsObservable, ()) {
  const QuotientProblem problem = any_quotient(12);
  const GeometricQuotient& q = problem.quotient;
  if (q.P.rows() > 0) {
    RC_ASSERT(q.H.rows() > 0 || q.P.rows() == 0);
    RC_ASSERT(reference::unobservable_subspace(q.M, q.A_0, size_of(problem.plant.C)).cols() == 0);
  }
}

Poles spread_poles(Index d, bool has_pairs) {
  Poles poles;
  for (Index i = 0; static_cast<Index>(poles.size()) < d; ++i) {
    const double real = -1.0 - 0.4 * static_cast<double>(i);
    if (has_pairs && d - static_cast<Index>(poles.size()) > 1) {
      poles.emplace_back(real, 0.7 + 0.1 * static_cast<double>(i));
      poles.emplace_back(std::conj(poles.back()));
    } else {
      poles.emplace_back(real);
    }
  }
  return poles;
}

// det(λI - F) against Π (λ - λ_i), in logarithms, where they are well conditioned: on a circle
// around the poles.
double polynomial_error(const MatrixXd& F, const Poles& poles) {
  double worst = 0.0;
  const double radius = 2.0 * std::max(1.0, F.norm());
  for (int k = 0; k < 2 * static_cast<int>(poles.size()) + 1; ++k) {
    const std::complex<double> at = std::polar(radius, 0.1 + 0.7 * k);
    const MatrixXcd pencil = at * MatrixXcd::Identity(F.rows(), F.cols()) - F;
    std::complex<double> quotient = pencil.partialPivLu().determinant();
    for (const std::complex<double>& pole : poles) {
      quotient /= at - pole;
    }
    worst = std::max(worst, std::abs(quotient - 1.0));
  }
  return worst;
}

// How far the pole is from being an eigenvalue of F: smallest singular value of F - λI.
double eigenvalue_error(const MatrixXd& F, std::complex<double> pole) {
  const MatrixXcd pencil = pole * MatrixXcd::Identity(F.rows(), F.cols()) - F;
  return Eigen::JacobiSVD<MatrixXcd>(pencil).singularValues().tail(1)[0] / F.norm();
}

RC_GTEST_PROP(CompleteFilter, HasTheCharacteristicPolynomialAskedFor, ()) {
  const QuotientProblem problem = any_quotient(8);
  const GeometricQuotient& q = problem.quotient;
  if (q.H.rows() == 0) {
    return;
  }
  const Poles poles = spread_poles(q.P.rows(), *rc::gen::element(false, true));
  const PolePlacement placement = place_poles(q.A_0, q.M, poles);
  RC_ASSERT(placement.is_possible);
  const GeometricFilter filter = complete_filter(q, placement);
  RC_ASSERT(polynomial_error(filter.F, poles) < 1e-6);
  for (const std::complex<double>& pole : poles) {
    RC_ASSERT(eigenvalue_error(filter.F, pole) < kRounding);
  }
  const double scale = 1.0 + filter.E.norm() * problem.plant.C.norm();
  RC_ASSERT((filter.F * q.P - q.P * problem.plant.A - filter.E * problem.plant.C).norm() <
            kRounding * scale);
}

// y1 = x1 + d, y2 = x2, y3 = d: y1 - y3 is free of the disturbance, and of faults on x2.
TEST(GeometricQuotient, UsesASensorThatSeesADisturbanceAlone) {
  const MatrixXd A = (MatrixXd(2, 2) << -1, 0, 1, -2).finished();
  const MatrixXd C = MatrixXd::Identity(3, 2);
  Directions ignored{MatrixXd::Zero(2, 2), MatrixXd::Zero(3, 2)};
  ignored.state(1, 0) = 1.0;
  ignored.output(0, 1) = 1.0;
  ignored.output(2, 1) = 1.0;
  const GeometricQuotient quotient =
      geometric_quotient(A, C, ignored, {MatrixXd::Identity(2, 2), MatrixXd::Zero(3, 2)});
  EXPECT_EQ(quotient.dim_s, 1);
  ASSERT_EQ(quotient.H.rows(), 1);
  EXPECT_NEAR(quotient.H(0, 0), -quotient.H(0, 2), 1e-12);
  EXPECT_NEAR(quotient.H(0, 1), 0.0, 1e-12);
}

}  // namespace
}  // namespace faultline

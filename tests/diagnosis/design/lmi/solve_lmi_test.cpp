#include <cmath>
#include <limits>
#include <string>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/design/lmi/lmi_problem.h"
#include "tests/support/random_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::HasSubstr;

constexpr std::complex<double> kI(0.0, 1.0);

double largest_eigenvalue(const MatrixXcd& M) {
  return Eigen::SelfAdjointEigenSolver<MatrixXcd>(M, Eigen::EigenvaluesOnly)
      .eigenvalues()
      .maxCoeff();
}

/// All inequalities hold at the solution, seen without scaling and embedding.
void expect_satisfied(const LmiProblem& problem, const LmiSolution& solution) {
  ASSERT_TRUE(solution.is_solved()) << solution.reason;
  for (const LmiProblem::Inequality& inequality : problem.inequalities()) {
    EXPECT_LT(largest_eigenvalue(inequality.E.at(solution.x)), 0.0) << inequality.name;
  }
}

MatrixXd constant(double value) { return MatrixXd::Constant(1, 1, value); }

TEST(SolveLmi, FindsTheLargestEigenvalueOfSymmetricMatrices) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    RandomNumbers random(seed);
    const auto n = static_cast<Index>(seed);
    const MatrixXd half = random.normal(n, n);
    const MatrixXd A = half + half.transpose();
    LmiProblem problem;
    const AffineMatrix t = problem.scalar();
    problem.require_negative("A < t", AffineMatrix(A) - multiple_of(MatrixXd::Identity(n, n), t));
    problem.minimise(t);
    const LmiSolution solution = solve(problem);
    expect_satisfied(problem, solution);
    EXPECT_NEAR(solution.objective, largest_eigenvalue(A.cast<std::complex<double>>()),
                1e-6 * A.norm())
        << "seed " << seed;
    EXPECT_NEAR(solution.bound, solution.objective, 1e-6 * A.norm());
  }
}

TEST(SolveLmi, FindsTheLargestEigenvalueOfHermitianMatrices) {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    RandomNumbers random(seed);
    const auto n = static_cast<Index>(seed) + 1;
    const AffineMatrix A = hermitian_part_twice(AffineMatrix(random.normal(n, n)) +
                                                kI * AffineMatrix(random.normal(n, n)));
    LmiProblem problem;
    const AffineMatrix t = problem.scalar();
    problem.require_negative("A < t", A - multiple_of(MatrixXd::Identity(n, n), t));
    problem.minimise(t);
    const LmiSolution solution = solve(problem);
    expect_satisfied(problem, solution);
    const MatrixXcd value = A.at(VectorXd());
    EXPECT_NEAR(solution.objective, largest_eigenvalue(value), 1e-6 * value.norm())
        << "seed " << seed;
  }
}

/// P = AᵀPA + Q, by its linear equations.
MatrixXd lyapunov_solution(const MatrixXd& A, const MatrixXd& Q) {
  const Index n = A.rows();
  MatrixXd equations = MatrixXd::Identity(n * n, n * n);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) {
      equations.block(i * n, j * n, n, n) -= A(j, i) * A.transpose();
    }
  }
  const VectorXd P = equations.partialPivLu().solve(VectorXd(Q.reshaped()));
  return P.reshaped(n, n);
}

TEST(SolveLmi, FindsTheSmallestSolutionOfTheLyapunovInequality) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    RandomNumbers random(seed);
    const auto n = static_cast<Index>(seed) + 1;
    MatrixXd A = random.normal(n, n);
    A *= 0.8 / A.norm();
    const MatrixXd Q = MatrixXd::Identity(n, n);
    const MatrixXd expected = lyapunov_solution(A, Q);
    ASSERT_LT((expected - A.transpose() * expected * A - Q).norm(), 1e-12);
    LmiProblem problem;
    const AffineMatrix P = problem.symmetric(n);
    problem.require_negative("Lyapunov", A.transpose() * P * A - P + AffineMatrix(Q));
    AffineMatrix trace(1, 1);
    for (Index i = 0; i < n; ++i) {
      const MatrixXd e_i = MatrixXd::Identity(n, n).col(i);
      trace += e_i.transpose() * P * e_i;
    }
    problem.minimise(trace);
    const LmiSolution solution = solve(problem);
    expect_satisfied(problem, solution);
    EXPECT_LT((solution.value(P) - expected).norm(), 1e-5 * expected.norm()) << "seed " << seed;
  }
}

TEST(SolveLmi, DoesNotMindUnitsThatAreFarApart) {
  // The Lyapunov inequality of a 2x2 block with units of 1e-4 and 1e4.
  const MatrixXd A = (MatrixXd(2, 2) << 0.5, 0.3e8, -0.2e-8, 0.6).finished();
  const MatrixXd Q = VectorXd{{1e-8, 1e8}}.asDiagonal();
  LmiProblem problem;
  const AffineMatrix P = problem.symmetric(2);
  problem.require_negative("Lyapunov", A.transpose() * P * A - P + AffineMatrix(Q));
  const MatrixXd weight = (MatrixXd(1, 2) << 1e4, 1e-4).finished();
  problem.minimise(weight * P * weight.transpose());
  const LmiSolution solution = solve(problem);
  ASSERT_TRUE(solution.is_solved()) << solution.reason;
  const MatrixXd expected = lyapunov_solution(A, Q);
  EXPECT_NEAR(solution.objective / (weight * expected * weight.transpose())(0, 0), 1.0, 1e-5);
}

TEST(SolveLmi, SaysThatContradictionsAreInfeasible) {
  LmiProblem numbers;
  const AffineMatrix x = numbers.scalar();
  numbers.require_positive("x > 1", x - AffineMatrix(constant(1.0)));
  numbers.require_negative("x < 0", x);
  EXPECT_EQ(solve(numbers).status, LmiStatus::kInfeasible);
  numbers.minimise(x);
  EXPECT_EQ(solve(numbers).status, LmiStatus::kInfeasible);

  LmiProblem unstable;
  const AffineMatrix P = unstable.symmetric(2);
  const MatrixXd A = (MatrixXd(2, 2) << 1.1, 1.0, 0.0, 0.5).finished();
  unstable.require_positive("P > 1", P - AffineMatrix(MatrixXd::Identity(2, 2)));
  unstable.require_negative("Lyapunov", A.transpose() * P * A - P);
  EXPECT_EQ(solve(unstable).status, LmiStatus::kInfeasible);
}

TEST(SolveLmi, SaysThatAnObjectiveIsUnbounded) {
  LmiProblem problem;
  const AffineMatrix x = problem.scalar();
  problem.require_negative("x < 1", x - AffineMatrix(constant(1.0)));
  problem.minimise(x);
  EXPECT_EQ(solve(problem).status, LmiStatus::kUnbounded);

  LmiProblem free;
  const AffineMatrix bounded = free.scalar();
  free.require_positive("> 0", bounded);
  free.minimise(bounded + free.scalar());
  EXPECT_EQ(solve(free).status, LmiStatus::kUnbounded);
}

TEST(SolveLmi, DoesNotCallUnboundedWhatHasNoSolutionAtAll) {
  LmiProblem problem;
  const AffineMatrix x = problem.scalar();
  const AffineMatrix y = problem.scalar();
  problem.require_negative("x < 1", x - AffineMatrix(constant(1.0)));
  problem.require_positive("y > 1", y - AffineMatrix(constant(1.0)));
  problem.require_negative("y < 0.9", y - AffineMatrix(constant(0.9)));
  problem.minimise(x);  // "unbounded" is what the solver says of this
  EXPECT_EQ(solve(problem).status, LmiStatus::kInfeasible);
}

TEST(SolveLmi, CallsNothingInfeasibleThatOnlyLacksAnOptimum) {
  // x y > 1, x > 0: the infimum of x is 0, for y = ∞.
  LmiProblem problem;
  const AffineMatrix x = problem.scalar();
  const AffineMatrix y = problem.scalar();
  problem.require_positive("hyperbola", hermitian({{x, constant(1.0)}, {y}}));
  problem.minimise(x);
  const LmiSolution solution = solve(problem);
  EXPECT_NE(solution.status, LmiStatus::kInfeasible);
  EXPECT_NE(solution.status, LmiStatus::kUnbounded);
  if (solution.is_solved()) expect_satisfied(problem, solution);
}

TEST(SolveLmi, FindsAPointWhereNothingIsMinimised) {
  LmiProblem problem;
  const AffineMatrix P = problem.symmetric(3);
  RandomNumbers random(3);
  MatrixXd A = random.normal(3, 3);
  A *= 0.9 / A.norm();
  problem.require_positive("P > 1", P - AffineMatrix(MatrixXd::Identity(3, 3)));
  problem.require_negative("Lyapunov", A.transpose() * P * A - P);
  expect_satisfied(problem, solve(problem));
}

TEST(SolveLmi, LeavesVariablesThatEnterNothingAtZero) {
  LmiProblem problem;
  const AffineMatrix unused = problem.full(2, 2);
  const AffineMatrix x = problem.scalar();
  problem.require_positive("x > 3", x - AffineMatrix(constant(3.0)));
  problem.minimise(x + AffineMatrix(constant(4.0)));
  const LmiSolution solution = solve(problem);
  expect_satisfied(problem, solution);
  EXPECT_NEAR(solution.objective, 7.0, 1e-6);
  EXPECT_EQ(solution.value(unused), MatrixXd::Zero(2, 2));
}

TEST(SolveLmi, RefusesDataThatAreNotFiniteAndNamesTheInequality) {
  LmiProblem problem;
  const AffineMatrix x = problem.scalar();
  problem.require_positive("the bad one",
                           x - AffineMatrix(constant(std::numeric_limits<double>::quiet_NaN())));
  try {
    static_cast<void>(solve(problem));
    FAIL() << "no exception";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("the bad one"));
  }
}

TEST(SolveLmi, RefusesAProblemWithoutVariables) {
  LmiProblem problem;
  problem.require_negative("constant", constant(-1.0));
  EXPECT_THROW(static_cast<void>(solve(problem)), std::invalid_argument);
}

TEST(SolveLmi, SaysWhatToChangeWhereThereAreTooManyVariables) {
  LmiProblem problem;
  const AffineMatrix P = problem.symmetric(60);
  problem.require_positive("P > 0", P);
  const LmiSolution solution = solve(problem);
  EXPECT_EQ(solution.status, LmiStatus::kInaccurate);
  EXPECT_THAT(solution.reason, HasSubstr("1830 variables"));
  EXPECT_THAT(solution.reason, HasSubstr("fewer states"));
}

}  // namespace
}  // namespace faultline

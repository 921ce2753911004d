#include "diagnosis/design/eigenstructure/assignment.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/diagnosis/design/eigenstructure/eigenstructure_oracle.h"
#include "tests/support/eigenvalues.h"
#include "tests/support/exact_arithmetic.h"
#include "tests/support/random_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using ::testing::HasSubstr;
using Complex = std::complex<double>;
using Poles = std::vector<Complex>;

MatrixXd matrix(std::initializer_list<std::initializer_list<double>> rows) {
  MatrixXd X(std::ssize(rows), std::ssize(*rows.begin()));
  Index i = 0;
  for (const auto& row : rows) {
    Index j = 0;
    for (const double value : row) X(i, j++) = value;
    ++i;
  }
  return X;
}

double difference(const MatrixXd& X, const MatrixXd& Y) {
  return X.rows() != Y.rows() || X.cols() != Y.cols() ? INFINITY : (X - Y).norm();
}

// Largest distance of the spectra as sets, relative to ‖A_0‖.
double spectrum_error(const MatrixXd& A_0, const Poles& expected) {
  const MatrixXd spectrum = [&] {
    MatrixXd diagonal = MatrixXd::Zero(A_0.rows(), A_0.rows());
    for (Index i = 0; i < A_0.rows();) {
      const Complex pole = expected[static_cast<std::size_t>(i)];
      diagonal(i, i) = pole.real();
      if (pole.imag() != 0.0) {
        diagonal(i + 1, i + 1) = pole.real();
        diagonal(i, i + 1) = pole.imag();
        diagonal(i + 1, i) = -pole.imag();
        ++i;
      }
      ++i;
    }
    return diagonal;
  }();
  Poles found = sorted_eigenvalues(A_0);
  double worst = 0.0;
  for (const Complex pole : sorted_eigenvalues(spectrum)) {
    const auto nearest = std::min_element(found.begin(), found.end(), [&](Complex a, Complex b) {
      return std::abs(a - pole) < std::abs(b - pole);
    });
    worst = std::max(worst, std::abs(*nearest - pole));
    found.erase(nearest);
  }
  return worst / A_0.norm();
}

// ‖W C (λ - A_0)⁻¹ E‖ to ‖W‖ ‖C (λ - A_0)⁻¹ E‖, the largest of a grid of λ.
double relative_leak(const MatrixXd& A, const MatrixXd& C, const MatrixXd& E,
                     const EigenstructureAssignment& found, bool is_sampled) {
  const MatrixXd A_0 = A - found.K * C;
  double worst = 0.0;
  for (int i = 0; i <= 40; ++i) {
    const Complex lambda = is_sampled ? std::polar(1.0, 3.14159 * i / 40)
                                      : Complex(0.0, i == 0 ? 0.0 : std::pow(10.0, 0.2 * i - 4));
    const MatrixXcd pencil = lambda * MatrixXcd::Identity(A.rows(), A.rows()) - A_0;
    const MatrixXcd state = pencil.partialPivLu().solve(E.cast<Complex>());
    const double undecoupled = found.W.norm() * C.norm() * state.norm();
    worst = std::max(worst, (found.W * C * state).norm() / undecoupled);
  }
  return worst;
}

Poles stable_poles(Index n, bool is_sampled, bool has_pair) {
  Poles poles;
  for (Index i = 0; i < n; ++i) {
    const double rate = 1.0 + 0.7 * static_cast<double>(i);
    poles.emplace_back(is_sampled ? std::exp(-0.3 * rate) : -rate, 0.0);
  }
  if (has_pair && n >= 3) {
    poles[1] = is_sampled ? std::polar(0.6, 0.5) : Complex(-2.0, 1.5);
    poles[2] = std::conj(poles[1]);
  }
  return poles;
}

std::string refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

// ------------------------------------------------------------------------------- the oracles

TEST(EigenstructureOracle, WeightsAreThoseOfTheAssignmentCases) {
  for (const auto& item : eigenstructure_oracle().at("assignment_cases")) {
    const MatrixXd C = oracle_matrix(item.at("C"));
    const DecouplingWeights weights = decoupling_weights(C, oracle_matrix(item.at("E")));
    EXPECT_EQ(weights.rank_C, item.at("rankC")) << item.at("seed");
    EXPECT_EQ(weights.rank_CE, item.at("rankCE"));
    EXPECT_EQ(weights.W_dynamic.rows(), item.at("n_W_dynamic"));
    EXPECT_EQ(weights.W_dynamic.rows() + weights.W_static.rows(), item.at("n_W_total"));
  }
}

TEST(EigenstructureOracle, AssignmentsAreThoseOfTheCases) {
  for (const auto& item : eigenstructure_oracle().at("assignment_cases")) {
    SCOPED_TRACE(fmt::format("case {}", item.at("seed").get<int>()));
    const MatrixXd A = oracle_matrix(item.at("A"));
    const MatrixXd C = oracle_matrix(item.at("C"));
    const MatrixXd E = oracle_matrix(item.at("E"));
    const DecouplingExistence existence = decoupling_existence(A, C, E);
    EXPECT_EQ(existence.left_rows > 0, item.at("left_feasible"));
    EXPECT_EQ(existence.is_right_solvable, item.at("right_feasible"));
    EXPECT_EQ(existence.exists(), item.at("geometric_feasible"));
    EXPECT_EQ(existence.rank_CW, item.at("rank_C_Wstar"));
    for (const bool is_left : {true, false}) {
      const auto& expected = item.at(is_left ? "left" : "right");
      if (expected.is_null()) {
        EXPECT_FALSE(assign_left(A, C, E, stable_poles(A.rows(), false, false), false).is_possible);
        continue;
      }
      // The whole numbers that the case was made with.
      Poles poles = oracle_poles(expected.at("eigs"));
      for (Complex& pole : poles) pole = std::round(pole.real());
      const EigenstructureAssignment found =
          is_left ? assign_left(A, C, E, poles, false) : assign_right(A, C, E, poles, false);
      ASSERT_TRUE(found.is_possible) << found.reason;
      const MatrixXd W = oracle_matrix(expected.at("W"));
      EXPECT_LT(difference(row_projector(found.W), row_projector(W)), 1e-9);
      EXPECT_LT(spectrum_error(A - found.K * C, poles), 1e-8);
      EXPECT_LT(relative_leak(A, C, E, found, false), 1e-10);
    }
  }
}

TEST(EigenstructureOracle, OnlyTheGeometricMethodDoesWhereNeitherEigenvectorsDo) {
  const auto& item = eigenstructure_oracle().at("geometric_only");
  const MatrixXd A = oracle_matrix(item.at("A"));
  const MatrixXd C = oracle_matrix(item.at("C"));
  const MatrixXd E = oracle_matrix(item.at("E"));
  const DecouplingExistence existence = decoupling_existence(A, C, E);
  EXPECT_EQ(existence.rank_C, item.at("rank_C"));
  EXPECT_EQ(existence.rank_CW, item.at("rank_CWstar"));
  EXPECT_TRUE(existence.exists());
  EXPECT_EQ(existence.left_rows, 0);
  EXPECT_FALSE(existence.is_right_solvable);
  const Poles poles = stable_poles(5, false, false);
  EXPECT_THAT(assign_left(A, C, E, poles, false).reason,
              HasSubstr("a residual exists by the geometric method"));
  EXPECT_THAT(assign_right(A, C, E, poles, false).reason, HasSubstr("rank C W* = 1 < rank C = 2"));
}

// ----------------------------------------------- each corrected statement, where the printed one
// breaks

// Theorem 1 names up to n - rank E independent weights: here 2, and there is 1.
TEST(JinTheorem1, NumberOfWeightsIsRankCLessRankCE) {
  const MatrixXd C = matrix({{1, 0, 0}});
  const MatrixXd E = matrix({{0}, {1}, {0}});
  EXPECT_EQ(decoupling_weights(C, E).W_dynamic.rows(), 1);
  // And its example: rank E = 2 < n = 3, yet none, as S(C') = S(E).
  const PaperExample paper = paper_example("ex1");
  const DecouplingWeights weights = decoupling_weights(paper.C, paper.E);
  EXPECT_EQ(weights.rank_CE, 2);
  EXPECT_EQ(weights.W_dynamic.rows(), 0);
  // The direction that E leaves free is h = (1, -1, 1), and no w has w C = h.
  const MatrixXd h = oracle_matrix(eigenstructure_oracle().at("ex1").at("E_perp"));
  EXPECT_LT((h * paper.E).norm(), 1e-15);
  EXPECT_GT(
      (h - h * paper.C.transpose() * (paper.C * paper.C.transpose()).inverse() * paper.C).norm(),
      0.5);
}

// Theorem 2: a row-deficient CE gives W, but H = W C may be zero; theorem 3: a full-rank E always
// makes it so.
TEST(JinTheorems2And3, WeightsOfAFullRankEAreStaticChecks) {
  const PaperExample paper = paper_example("ex3");
  const DecouplingWeights weights = decoupling_weights(paper.C, paper.E);
  ASSERT_EQ(weights.W_static.rows(), 1);
  EXPECT_EQ(weights.W_dynamic.rows(), 0);
  EXPECT_LT((weights.W_static * paper.C).norm(), 1e-14);
  const MatrixXd w = oracle_matrix(eigenstructure_oracle().at("ex3").at("W"));
  EXPECT_LT(difference(row_projector(weights.W_static), row_projector(w)), 1e-14);
  // A residual of it is blind to the plant: assignment says so.
  const MatrixXd A = -MatrixXd::Identity(3, 3);
  EXPECT_THAT(assign_left(A, paper.C, paper.E, stable_poles(3, false, false), false).reason,
              HasSubstr("static solutions only"));
}

// (6) asks for H A_0 = 0: in continuous time A_0 has the eigenvalue 0 then, whatever is left free.
TEST(JinCondition6, DeadBeatIsStableInDiscreteTimeOnly) {
  const MatrixXd A = matrix({{0.5, 1, 0}, {0, 0.3, 1}, {1, 0, 0.2}});
  const MatrixXd C = MatrixXd::Identity(3, 3);
  const MatrixXd E = matrix({{1}, {0}, {0}});
  const Poles poles{0.0, 0.0, -2.0};
  EXPECT_THAT(refusal([&] { static_cast<void>(assign_left(A, C, E, poles, false)); }),
              HasSubstr("dead-beat, 0, is stable in discrete time only"));
  const Poles sampled{0.0, 0.0, 0.5};
  const EigenstructureAssignment found = assign_left(A, C, E, sampled, true);
  ASSERT_TRUE(found.is_possible);
  EXPECT_LT((found.W * C * (A - found.K * C)).norm(), 1e-14);
  EXPECT_EQ(found.W.rows(), 2);
}

// Theorem 4 asks for S((CE)') = S((CE)', (AE)'): right for Λ = 0 only. Here CE = 0 and A E = -E: it
// fails, and Λ = -1 does.
TEST(JinTheorem4, RightEigenvectorsNeedNotBelongToZero) {
  const MatrixXd A = matrix({{-1, 0, 0}, {0, -2, 1}, {0, 0, -3}});
  const MatrixXd C = matrix({{0, 1, 0}});
  const MatrixXd E = matrix({{1}, {0}, {0}});
  ASSERT_LT((C * E).norm(), 1e-15);
  ASSERT_GT((A * E).norm(), 0.5);
  const EigenstructureAssignment found =
      assign_right(A, C, E, stable_poles(3, false, false), false);
  ASSERT_TRUE(found.is_possible) << found.reason;
  EXPECT_NEAR(found.Lambda(0, 0), -1.0, 1e-14);
  ASSERT_EQ(found.fixed.size(), 1u);
  EXPECT_NEAR(found.fixed[0].real(), -1.0, 1e-14);
}

// Theorem 5 with its bars and a Λ: K CE = A E - E Λ.
TEST(JinTheorem5, GainSolvesItsEquation) {
  const MatrixXd A = matrix({{0, 1, 0}, {-2, -1, 1}, {1, 0, -3}});
  const MatrixXd C = matrix({{1, 0, 0}, {0, 1, 0}});
  const MatrixXd E = matrix({{0}, {1}, {1}});
  const EigenstructureAssignment found =
      assign_right(A, C, E, stable_poles(3, false, false), false);
  ASSERT_TRUE(found.is_possible) << found.reason;
  const MatrixXd& basis = found.basis;
  EXPECT_LT((found.K * C * basis - A * basis + basis * found.Lambda).norm(), 1e-13);
}

// "Only S(C A_0) within S(CE)" is sufficient, not necessary: S(C A_0) within Ker W is what counts.
TEST(JinAfterTheorem5, ImageOfCA0NeedNotBeWithinThatOfCE) {
  const MatrixXd A = matrix({{0.5, 1, 0}, {0, 0.3, 1}, {1, 0, 0.2}});
  const MatrixXd C = MatrixXd::Identity(3, 3);
  const MatrixXd W = matrix({{0, 1, 0}});
  const MatrixXd E = matrix({{1}, {0}, {0}});
  MatrixXd A_0 = MatrixXd::Zero(3, 3);
  A_0(2, 2) = 0.5;  // K = A - A_0
  EXPECT_LT((W * C * A_0).norm(), 1e-15);
  EXPECT_LT((W * C * E).norm(), 1e-15);
  MatrixXd both(3, 4);
  both << C * A_0, C * E;
  EXPECT_GT(both.jacobiSvd().rank(), (C * E).jacobiSvd().rank());
}

// Theorem 6: β' Ā = 0 takes Im Ā within Ker β', of dimension p - r; rank Ā = p - r is neither
// necessary nor sufficient.
TEST(JinTheorem6, RankOfABarDecidesNothing) {
  const MatrixXd beta = matrix({{1, 0}, {0, 0}});  // p = 2, r = 1
  const MatrixXd of_rank_one = matrix({{1, 0}, {0, 0}});
  EXPECT_GT((beta.transpose() * of_rank_one).norm(), 0.5);
  EXPECT_EQ((beta.transpose() * MatrixXd::Zero(2, 2)).norm(), 0.0);
}

// ----------------------------------------------------------------------------- random systems

struct RandomSystem {
  MatrixXd A, C, E;
};

// Small whole numbers, so that ranks can be had exactly; C of deficient rank in every fifth,
// unknown inputs that move no output at first in every fourth, a stable invariant zero in every
// ninth.
RandomSystem random_system(std::uint64_t seed) {
  RandomNumbers random(seed);
  const Index n = random.whole(2, 6);
  const Index q = random.whole(std::max<Index>(1, n - 3), n);
  const Index l = random.whole(1, std::max<Index>(1, q - 1));
  RandomSystem system{random.whole(n, n, 2), random.whole(q, n, 1), random.whole(n, l, 2)};
  if (seed % 5 == 0 && q > 1) {
    system.C.row(q - 1) = system.C.row(0);
  }
  if (seed % 4 == 0 && q < n) {
    system.C = MatrixXd::Identity(q, n);
    system.E.topRows(q).setZero();
    system.E(n - 1, 0) = 1.0;
  }
  while (system.E.isZero(0.0)) system.E = random.whole(n, l, 2);
  if (seed % 9 == 0) {  // (A + I) e_n = E e_1, C e_n = 0: the zero -1
    system.C.col(n - 1).setZero();
    system.A.col(n - 1) = system.E.col(0) - MatrixXd::Identity(n, n).col(n - 1);
  }
  if (system.C.isZero(0.0)) system.C(0, 0) = 1.0;
  return system;
}

constexpr std::uint64_t kSystems = 400;

TEST(EigenstructureRandom, NumbersOfWeightsAndFeasibilityAreExact) {
  int counts[3] = {};
  int wrong_by_the_paper = 0;
  for (std::uint64_t seed = 1; seed <= kSystems; ++seed) {
    SCOPED_TRACE(fmt::format("seed {}", seed));
    const auto [A, C, E] = random_system(seed);
    const ExactMatrix a(A), c(C), e(E);
    const Index rank_C = rank(c);
    const DecouplingWeights weights = decoupling_weights(C, E);
    EXPECT_EQ(weights.rank_C, rank_C);
    EXPECT_EQ(weights.W_dynamic.rows(), rank_C - rank(c * e));
    EXPECT_EQ(weights.W_static.rows(), C.rows() - rank_C);
    EXPECT_LT((weights.W_dynamic * C * E).norm(), 1e-12 * C.norm() * E.norm());
    EXPECT_LT((weights.W_static * C).norm(), 1e-13 * C.norm());
    wrong_by_the_paper += weights.W_dynamic.rows() != A.rows() - rank(e) ? 1 : 0;

    const DecouplingExistence existence = decoupling_existence(A, C, E);
    EXPECT_EQ(existence.left_rows, rank_C - rank(side_by_side(c * e, c * a * kernel(c))));
    EXPECT_EQ(existence.rank_CW, rank(c * exact_unobservability_subspaces(a, c, e).W));
    // A E k within Im E for every k of Ker CE.
    const ExactMatrix moved = a * e * kernel(c * e);
    EXPECT_EQ(existence.is_right_solvable,
              rank(side_by_side(e, moved)) == rank(e) && rank(c * e) < rank_C);
    counts[0] += existence.left_rows > 0 ? 1 : 0;
    counts[1] += existence.is_right_solvable ? 1 : 0;
    counts[2] += existence.exists() && existence.left_rows == 0 && !existence.is_right_solvable;
    if (existence.left_rows > 0 || existence.is_right_solvable) {
      EXPECT_TRUE(existence.exists());  // sufficient
    }
  }
  // The sample holds all kinds, and many for which the paper's number is wrong.
  EXPECT_GT(counts[0], 50);
  EXPECT_GT(counts[1], 50);
  EXPECT_GT(counts[2], 0);
  EXPECT_GT(wrong_by_the_paper, 100);
}

class RandomAssignment : public ::testing::TestWithParam<bool> {};

TEST_P(RandomAssignment, PlacesTheSpectrumAndDecouples) {
  const bool is_sampled = GetParam();
  int left_count = 0, right_count = 0, zeros = 0;
  for (std::uint64_t seed = 1; seed <= kSystems; ++seed) {
    SCOPED_TRACE(fmt::format("seed {}", seed));
    const auto [A_whole, C, E] = random_system(seed);
    const MatrixXd A = is_sampled ? MatrixXd(A_whole / 4.0) : A_whole;
    const Poles poles = stable_poles(A.rows(), is_sampled, seed % 3 == 0);
    for (const bool is_left : {true, false}) {
      const EigenstructureAssignment found = is_left ? assign_left(A, C, E, poles, is_sampled)
                                                     : assign_right(A, C, E, poles, is_sampled);
      if (!found.is_possible) {
        EXPECT_FALSE(found.reason.empty());
        continue;
      }
      (is_left ? left_count : right_count)++;
      const MatrixXd A_0 = A - found.K * C;
      if (is_left) {
        EXPECT_LT((found.basis * A_0 - found.Lambda * found.basis).norm(),
                  1e-10 * A_0.norm() * found.basis.norm());
      } else {
        EXPECT_LT((A_0 * found.basis - found.basis * found.Lambda).norm(), 1e-10 * A_0.norm());
      }
      // What was asked for, but for the fixed ones: each of those is there, the others are ours.
      Poles left = sorted_eigenvalues(A_0);
      Poles asked = poles;
      for (const Complex fixed : found.fixed) {
        const auto nearest = std::min_element(left.begin(), left.end(), [&](Complex a, Complex b) {
          return std::abs(a - fixed) < std::abs(b - fixed);
        });
        EXPECT_LT(std::abs(*nearest - fixed), 1e-7 * A_0.norm());
        left.erase(nearest);
      }
      for (const Complex value : left) {
        const auto nearest = std::min_element(
            asked.begin(), asked.end(),
            [&](Complex a, Complex b) { return std::abs(a - value) < std::abs(b - value); });
        EXPECT_LT(std::abs(*nearest - value), 1e-8 * A_0.norm());
        asked.erase(nearest);
      }
      zeros += is_left || found.fixed.empty() ? 0 : 1;
      EXPECT_LT(relative_leak(A, C, E, found, is_sampled), 1e-10);
    }
  }
  EXPECT_GT(left_count, 50);
  EXPECT_GT(right_count, 50);
  EXPECT_GT(zeros, 5);
}

INSTANTIATE_TEST_SUITE_P(Domains, RandomAssignment, ::testing::Bool(), [](const auto& domain) {
  return domain.param ? "Sampled" : "Continuous";
});

// ---------------------------------------------------------------------------------- bad input

TEST(EigenstructureBadInput, IsRefusedWithWhatWasExpected) {
  const MatrixXd A = -MatrixXd::Identity(3, 3);
  const MatrixXd C = MatrixXd::Identity(2, 3);
  const MatrixXd E = matrix({{1}, {0}, {0}});
  const Poles poles = stable_poles(3, false, false);
  const auto with = [&](const MatrixXd& C_, const MatrixXd& E_, const Poles& poles_) {
    return refusal([&] { static_cast<void>(assign_left(A, C_, E_, poles_, false)); });
  };
  EXPECT_EQ(with(C, E, poles), "");
  EXPECT_THAT(with(C, matrix({{1}, {0}}), poles), HasSubstr("E 2×1, expected n×n, q×n, n×l"));
  EXPECT_THAT(with(C, MatrixXd::Zero(3, 2), poles), HasSubstr("without a column that is not zero"));
  EXPECT_THAT(with(C, MatrixXd(3, 0), poles), HasSubstr("without a column that is not zero"));
  EXPECT_THAT(with(C, matrix({{1}, {std::nan("")}, {0}}), poles), HasSubstr("NaN or infinity"));
  EXPECT_THAT(with(C, E, {-1.0, -2.0}), HasSubstr("found 2 poles, expected 3"));
  EXPECT_THAT(with(C, E, {-1.0, 2.0, -3.0}), HasSubstr("found pole 2, expected negative real"));
  EXPECT_THAT(with(C, E, {-1.0, {-2.0, 1.0}, -3.0}),
              HasSubstr("found pole -2+1i, expected its conjugate -2-1i behind it"));
  const MatrixXd none = MatrixXd::Zero(2, 3);
  EXPECT_THAT(assign_right(A, none, E, poles, false).reason, HasSubstr("rank C"));
  EXPECT_THAT(refusal([&] { static_cast<void>(decoupling_weights(C, matrix({{1}}))); }),
              HasSubstr("expected q×n, n×l"));
}

TEST(EigenstructureBadInput, PairsThatCannotBeSplitAreNamed) {
  const MatrixXd A = matrix({{0, 1}, {-1, 0}});
  const MatrixXd C = MatrixXd::Identity(2, 2);
  const MatrixXd E = matrix({{1}, {0}});
  const Poles pair{{-1.0, 1.0}, {-1.0, -1.0}};
  EXPECT_THAT(assign_left(A, C, E, pair, false).reason, HasSubstr("give a real one"));
}

}  // namespace
}  // namespace faultline

#include "diagnosis/design/eigenstructure/compromise.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/pole_placement.h"
#include "tests/diagnosis/design/eigenstructure/eigenstructure_oracle.h"
#include "tests/support/random_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Complex = std::complex<double>;

// Unknown inputs of a paper's example; a fault of each sensor is wanted.
CompromiseTask static_task(const PaperExample& paper) {
  const Index n = paper.C.cols();
  const Index q = paper.C.rows();
  return {-MatrixXd::Identity(n, n),
          paper.C,
          {paper.E, MatrixXd::Zero(q, paper.E.cols())},
          {MatrixXd::Zero(n, q), MatrixXd::Identity(q, q)},
          false};
}

// Examples 2 and 4: σ = 1.79546 and 4.96081; the row of the smallest costs 1.79546, the literal
// text's (the first of a descending order) 4.96081.
TEST(JinExample4, LowRankRemovesTheSmallestSingularValue) {
  const CompromiseTask task = static_task(paper_example("ex4"));
  const auto& oracle = eigenstructure_oracle().at("ex4");
  const UnknownInputSpread spread = unknown_input_spread(task);
  EXPECT_NEAR(spread.singular_values[0], oracle.at("sv").at(1).get<double>(), 1e-12);
  EXPECT_NEAR(spread.singular_values[1], oracle.at("sv").at(0).get<double>(), 1e-12);
  const MatrixXd w = low_rank_rows(task, 1);
  EXPECT_LT((row_projector(w) - row_projector(oracle_matrix(oracle.at("w_smallest")))).norm(),
            1e-12);
  EXPECT_NEAR((w * task.M * task.unknown.state).norm(), 1.7954568557975594, 1e-12);
  const MatrixXd literal = oracle_matrix(oracle.at("w_literal_text"));
  EXPECT_NEAR((literal * task.M * task.unknown.state).norm(),
              oracle.at("sigma_literal").get<double>(), 1e-12);
}

TEST(JinExample4, StaticCriterionIsSmallerThanThePapersChoice) {
  const CompromiseTask task = static_task(paper_example("ex4"));
  const auto& oracle = eigenstructure_oracle().at("ex4");
  const MatrixXd w = static_rows(task, 1);
  EXPECT_LT((row_projector(w) - row_projector(oracle_matrix(oracle.at("w_exact13")))).norm(),
            1e-12);
  const auto cost = [&](const MatrixXd& row) {
    const MatrixXd H = row * task.M;
    return (H * task.unknown.state).norm() / H.norm();
  };
  EXPECT_NEAR(cost(w), oracle.at("sqrtJ_exact13").at(0).get<double>(), 1e-12);
  EXPECT_NEAR(cost(low_rank_rows(task, 1)), oracle.at("sqrtJ_of_paper_w").get<double>(), 1e-12);
  EXPECT_LT(cost(w), cost(low_rank_rows(task, 1)));
  // All rows: the second generalised eigenvalue is 2.86916².
  const MatrixXd both = static_rows(task, 2) * task.M;
  EXPECT_LT((both * both.transpose() - MatrixXd::Identity(2, 2)).norm(), 1e-12);
  EXPECT_NEAR((both.row(1) * task.unknown.state).norm(), 2.86916, 1e-5);
}

// Example 2: E = V diag(1, 2, 3) T', and no left singular vector of E is a row of C: Patton's own
// choice of H cannot be had as W C.
TEST(JinExample2, LeftSingularVectorsOfEAreNoRowsOfC) {
  const auto& oracle = eigenstructure_oracle().at("ex2");
  const PaperExample corrected = paper_example("ex2", "E_corrected");
  CompromiseTask task = static_task(corrected);
  task.M = MatrixXd::Identity(3, 3);  // E itself
  task.unknown.output = MatrixXd::Zero(3, 4);
  const UnknownInputSpread spread = unknown_input_spread(task);
  EXPECT_LT((spread.singular_values - Eigen::Vector3d(1.0, 2.0, 3.0)).norm(), 1e-12);
  task.unknown.state = oracle_matrix(oracle.at("E_printed"));
  const VectorXd printed = unknown_input_spread(task).singular_values;
  EXPECT_NEAR(printed[0], oracle.at("sv_printed").at(2).get<double>(), 1e-12);
  EXPECT_GT(std::abs(printed[2] - 3.0), 0.02);
  const Eigen::Vector3d kernel = Eigen::Vector3d(1.0, -1.0, 1.0).normalized();
  for (Index i = 0; i < 3; ++i) {
    const double outside = std::abs(spread.U.col(i).dot(kernel));
    EXPECT_NEAR(outside, oracle.at("v_dot_kerC").at(static_cast<std::size_t>(i)).get<double>(),
                1e-12);
  }
}

// Eckart, Young: no row of length one leaves less than the smallest singular value.
TEST(LowRankRows, CostNoMoreThanAnyOtherRows) {
  RandomNumbers random(7);
  const CompromiseTask task = static_task(paper_example("ex4"));
  for (int trial = 0; trial < 1000; ++trial) {
    const VectorXd w = random.normal(2, 1).col(0).normalized();
    EXPECT_GE((w.transpose() * task.M * task.unknown.state).norm(), 1.7954568557975594 - 1e-12);
    const VectorXd H = (w.transpose() * task.M).transpose().normalized();
    EXPECT_GE((H.transpose() * task.unknown.state).norm(), 1.7923072034499414 - 1e-12);
  }
}

// ------------------------------------------------------------------------------------- by gain

struct GainCase {
  CompromiseTask task;
  MatrixXd D_1;
};

GainCase gain_case(std::uint64_t seed, bool is_sampled, bool is_direct) {
  RandomNumbers random(seed);
  const Index n = random.whole(2, 4);
  const Index q = random.whole(2, 3);
  MatrixXd A = random.normal(n, n);
  if (is_sampled) A /= 2.0 * A.norm();
  CompromiseTask task{A,
                      random.normal(q, n),
                      {random.normal(n, q), MatrixXd::Zero(q, q)},
                      {random.normal(n, 2), random.normal(q, 2)},
                      is_sampled};
  if (is_direct) task.unknown.output = 0.3 * random.normal(q, q);
  std::vector<Complex> poles;
  for (Index i = 0; i < n; ++i) {
    const double rate = 1.0 + 0.5 * static_cast<double>(i);
    poles.emplace_back(is_sampled ? std::exp(-0.3 * rate) : -rate, 0.0);
  }
  const PolePlacement placement = place_poles(task.A_0, task.M, poles);
  EXPECT_TRUE(placement.is_possible);
  return {task, placement.D_1};
}

// The ratio once more, by a grid of its own.
double ratio_on_grid(const GainCase& at, const MatrixXd& Theta) {
  const CompromiseTask& task = at.task;
  const MatrixXd F = task.A_0 + at.D_1 * task.M;
  const auto response = [&](const Directions& in, Complex lambda) -> MatrixXcd {
    const MatrixXcd pencil = lambda * MatrixXcd::Identity(F.rows(), F.rows()) - F;
    const MatrixXd b = in.state + at.D_1 * in.output;
    return Theta * (task.M * pencil.partialPivLu().solve(b.cast<Complex>()) + in.output);
  };
  double gain = 0.0;
  for (int i = 0; i <= 2000; ++i) {
    const Complex lambda = task.is_sampled
                               ? std::polar(1.0, M_PI * i / 2000)
                               : Complex(0.0, i == 0 ? 0.0 : std::pow(10.0, -3.0 + 6.0 * i / 2000));
    const MatrixXcd T = response(task.unknown, lambda);
    gain = std::max(gain, Eigen::JacobiSVD<MatrixXcd>(T).singularValues()[0]);
  }
  double wanted = std::numeric_limits<double>::infinity();
  for (Index j = 0; j < task.wanted.state.cols(); ++j) {
    const Directions one{task.wanted.state.col(j), task.wanted.output.col(j)};
    wanted = std::min(wanted, response(one, task.is_sampled ? 1.0 : 0.0).norm());
  }
  return gain / wanted;
}

class CompromiseByGain : public ::testing::TestWithParam<bool> {};

TEST_P(CompromiseByGain, IsWorthWhatItSaysAndBeatsEverythingTried) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    SCOPED_TRACE(fmt::format("seed {}", seed));
    const GainCase at = gain_case(seed, GetParam(), seed % 2 == 0);
    const Index q = at.task.M.rows();
    const auto found = compromises_by_gain(at.task, at.D_1, CompromiseCriterion::kWorstCase);
    ASSERT_EQ(std::ssize(found), q);
    double before = std::numeric_limits<double>::infinity();
    for (Index p = 1; p <= q; ++p) {
      const Compromise& of_rows = found[static_cast<std::size_t>(p - 1)];
      ASSERT_TRUE(of_rows.is_possible) << of_rows.reason;
      EXPECT_LE(of_rows.Theta.rows(), p);
      EXPECT_NEAR(of_rows.ratio / ratio_on_grid(at, of_rows.Theta), 1.0, 1e-3);
      EXPECT_LE(of_rows.ratio, before);  // a row more never costs
      before = of_rows.ratio;
    }
    // Neither any rows as they are, nor random weights, do better than the optimum.
    RandomNumbers random(seed);
    for (int trial = 0; trial < 300; ++trial) {
      const MatrixXd Theta = random.normal(random.whole(1, q), q);
      EXPECT_GE(compromise_ratio(at.task, at.D_1, Theta, CompromiseCriterion::kWorstCase),
                0.998 * found.back().ratio);
    }
  }
}

TEST_P(CompromiseByGain, RmsIsThatOfSimulatedNoise) {
  const GainCase at = gain_case(3, GetParam(), false);
  const auto found = compromises_by_gain(at.task, at.D_1, CompromiseCriterion::kRms);
  ASSERT_TRUE(found.back().is_possible) << found.back().reason;
  RandomNumbers random(5);
  for (int trial = 0; trial < 300; ++trial) {
    const MatrixXd Theta = random.normal(2, at.task.M.rows());
    EXPECT_GE(compromise_ratio(at.task, at.D_1, Theta, CompromiseCriterion::kRms),
              0.998 * found.back().ratio);
  }
  if (!GetParam()) return;
  // 200 000 samples of white noise.
  const MatrixXd F = at.task.A_0 + at.D_1 * at.task.M;
  VectorXd e = VectorXd::Zero(F.rows());
  double power = 0.0;
  constexpr int kSamples = 200'000;
  for (int k = 0; k < kSamples; ++k) {
    power += (found.back().Theta * at.task.M * e).squaredNorm();
    e = F * e + at.task.unknown.state * random.normal(at.task.unknown.state.cols(), 1);
  }
  const MatrixXd I = MatrixXd::Identity(F.rows(), F.rows());
  double wanted = std::numeric_limits<double>::infinity();
  for (Index j = 0; j < at.task.wanted.state.cols(); ++j) {
    const VectorXd b = at.task.wanted.state.col(j) + at.D_1 * at.task.wanted.output.col(j);
    const VectorXd r = found.back().Theta *
                       (at.task.M * (I - F).partialPivLu().solve(b) + at.task.wanted.output.col(j));
    wanted = std::min(wanted, r.norm());
  }
  EXPECT_NEAR(std::sqrt(power / kSamples) / wanted / found.back().ratio, 1.0, 0.02);
}

TEST_P(CompromiseByGain, TradeOffGainsDecayAsAsked) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(fmt::format("seed {}", seed));
    const GainCase at = gain_case(seed, GetParam(), seed % 2 == 0);
    const double decay = GetParam() ? 0.8 : 0.7;
    const auto gains = trade_off_gains(at.task, decay);
    EXPECT_GE(gains.size(), 8u);
    for (const MatrixXd& D_1 : gains) {
      for (const Complex pole : eigenvalues(at.task.A_0 + D_1 * at.task.M)) {
        EXPECT_LE(GetParam() ? std::abs(pole) : pole.real(), (GetParam() ? decay : -decay) + 1e-6);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Domains, CompromiseByGain, ::testing::Bool(), [](const auto& domain) {
  return domain.param ? "Sampled" : "Continuous";
});

TEST(CompromiseByGain, WhiteNoiseStraightToAnOutputHasNoRmsInContinuousTime) {
  const GainCase at = gain_case(2, false, true);
  const auto found = compromises_by_gain(at.task, at.D_1, CompromiseCriterion::kRms);
  EXPECT_FALSE(found.front().is_possible);
  EXPECT_NE(found.front().reason.find("no finite rms"), std::string::npos);
}

// Of a direction that unknown inputs do not reach the program makes (nearly) nothing but use.
TEST(CompromiseByGain, FindsADirectionThatUnknownInputsMiss) {
  const MatrixXd C = MatrixXd::Identity(2, 2);
  MatrixXd E(2, 1);
  E << 1.0, 1.0;
  const CompromiseTask task{-MatrixXd::Identity(2, 2),
                            C,
                            {E, MatrixXd::Zero(2, 1)},
                            {MatrixXd::Identity(2, 2), MatrixXd::Zero(2, 2)},
                            false};
  const auto found =
      compromises_by_gain(task, MatrixXd::Zero(2, 2), CompromiseCriterion::kWorstCase);
  ASSERT_TRUE(found[0].is_possible) << found[0].reason;
  EXPECT_LT(found[0].ratio, 1e-4);
}

}  // namespace
}  // namespace faultline

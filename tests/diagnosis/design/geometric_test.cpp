#include "diagnosis/design/geometric.h"

#include <random>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "tests/diagnosis/geometric_oracle.h"
#include "tests/support/eigenvalues.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Certificates are exact algebra: only rounding is left.
constexpr double kExact = 1e-11;

MatrixXd projector(const MatrixXd& basis) { return basis * basis.transpose(); }

Directions no_output(const MatrixXd& state, Index q) {
  return {state, MatrixXd::Zero(q, state.cols())};
}

class RandomPlants {
 public:
  explicit RandomPlants(std::uint64_t seed) : engine_(seed) {}
  /// Small whole numbers: low rank and coincidences are frequent.
  MatrixXd matrix(Index rows, Index cols) {
    return MatrixXd::NullaryExpr(rows, cols, [this] {
      return static_cast<double>(std::uniform_int_distribution<int>(-2, 2)(engine_));
    });
  }
  MatrixXd gaussian(Index rows, Index cols) {
    return MatrixXd::NullaryExpr(rows, cols, [this] { return normal_(engine_); });
  }

 private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

TEST(UnobservabilitySubspaces, AgreeWithTheOracleOnAllCases) {
  for (const OracleCase& oracle : oracle_cases()) {
    // Output projection, done here by hand: N Df = 0.
    const MatrixXd N = complement(SubspaceArithmetic().image(oracle.Df, 1.0)).transpose();
    for (const OracleResidual& expected : oracle.residuals) {
      SCOPED_TRACE(oracle.name);
      MatrixXd L(oracle.A.rows(), std::ssize(expected.ignores));
      for (Index i = 0; i < L.cols(); ++i) {
        L.col(i) = oracle.B.col(static_cast<Index>(expected.ignores[static_cast<std::size_t>(i)]));
      }
      SubspaceArithmetic arithmetic;
      const UnobservabilitySubspaces found =
          unobservability_subspaces(oracle.A, N * oracle.C, L, arithmetic);
      EXPECT_LT((projector(found.W) - expected.projector_w).norm(), 1e-8);
      EXPECT_LT((projector(found.S) - expected.projector_s).norm(), 1e-8);
      EXPECT_GT(arithmetic.margin().smallest_kept, 1e3 * kRankTolerance);
      EXPECT_LT(arithmetic.margin().largest_dropped, 1e-3 * kRankTolerance);
    }
  }
}

TEST(UnobservabilitySubspaces, AreInvariantAndContainTheirDirections) {
  const std::uint64_t seed = test_seed(20);
  SCOPED_TRACE(seed_message(seed));
  RandomPlants plants(seed);
  for (int trial = 0; trial < 200; ++trial) {
    const MatrixXd A = plants.matrix(5, 5);
    const MatrixXd C = plants.matrix(2, 5);
    const MatrixXd L = plants.matrix(5, 1 + trial % 2);
    SubspaceArithmetic arithmetic;
    const auto [W, S] = unobservability_subspaces(A, C, L, arithmetic);
    const auto outside = [](const MatrixXd& space, const MatrixXd& X) {
      return (X - space * (space.transpose() * X)).norm();
    };
    EXPECT_LT(outside(W, L), kExact * (1.0 + L.norm()));
    EXPECT_LT(outside(S, W), kExact);
    for (const MatrixXd& space : {W, S}) {
      const MatrixXd unseen = space * arithmetic.kernel(C * space, C.norm());
      EXPECT_LT(outside(space, A * unseen), kExact * A.norm());
    }
  }
}

TEST(UnobservabilitySubspaces, FollowAChangeOfStateCoordinates) {
  const std::uint64_t seed = test_seed(21);
  SCOPED_TRACE(seed_message(seed));
  RandomPlants plants(seed);
  for (int trial = 0; trial < 100; ++trial) {
    const MatrixXd A = plants.matrix(4, 4);
    const MatrixXd C = plants.matrix(2, 4);
    const MatrixXd L = plants.matrix(4, 1);
    const MatrixXd T = MatrixXd::Identity(4, 4) + 0.2 * plants.gaussian(4, 4);
    const MatrixXd T_inverse = T.inverse();
    SubspaceArithmetic arithmetic;
    const MatrixXd S = unobservability_subspaces(A, C, L, arithmetic).S;
    const MatrixXd S_moved =
        unobservability_subspaces(T_inverse * A * T, C * T, T_inverse * L, arithmetic).S;
    EXPECT_LT((projector(arithmetic.image(T_inverse * S, 1.0)) - projector(S_moved)).norm(), 1e-8);
  }
}

TEST(GeometricQuotient, FulfilsItsEquationsForDirectionsOfEveryKind) {
  const std::uint64_t seed = test_seed(22);
  SCOPED_TRACE(seed_message(seed));
  RandomPlants plants(seed);
  int with_residual = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const MatrixXd A = plants.matrix(5, 5);
    const MatrixXd C = plants.matrix(4, 5);
    Directions ignored{plants.matrix(5, 2), MatrixXd::Zero(4, 2)};
    if (trial % 2 == 1) {
      ignored.output.col(1) = plants.matrix(4, 1);  // a mixed direction
    }
    if (trial % 4 == 3) {
      ignored.state.col(1).setZero();  // a sensor
    }
    const GeometricQuotient q = geometric_quotient(A, C, ignored, ignored);
    const double scale = 1.0 + A.norm() + q.E_0.norm() * C.norm();
    EXPECT_LT((q.M * q.P - q.H * C).norm(), kExact * scale);
    EXPECT_LT((q.A_0 * q.P - q.P * A - q.E_0 * C).norm(), kExact * scale);
    EXPECT_LT((q.P * ignored.state + q.E_0 * ignored.output).norm(), kExact * scale);
    EXPECT_LT((q.H * ignored.output).norm(), kExact * scale);
    EXPECT_LT((q.P * q.P.transpose() - MatrixXd::Identity(q.P.rows(), q.P.rows())).norm(), kExact);
    with_residual += q.H.rows() > 0 ? 1 : 0;
  }
  EXPECT_GT(with_residual, 50);
}

TEST(GeometricQuotient, OfAnOutputDirectionIsTheOneOfTheProjectedOutput) {
  for (const OracleCase& oracle : oracle_cases()) {
    const Index q = oracle.C.rows();
    for (const OracleResidual& expected : oracle.residuals) {
      SCOPED_TRACE(oracle.name);
      const Index count = std::ssize(expected.ignores);
      Directions ignored{MatrixXd::Zero(oracle.A.rows(), count + oracle.Df.cols()),
                         MatrixXd::Zero(q, count + oracle.Df.cols())};
      for (Index i = 0; i < count; ++i) {
        ignored.state.col(i) =
            oracle.B.col(static_cast<Index>(expected.ignores[static_cast<std::size_t>(i)]));
      }
      ignored.output.rightCols(oracle.Df.cols()) = oracle.Df;
      const GeometricQuotient found =
          geometric_quotient(oracle.A, oracle.C, ignored, no_output(oracle.B, q));
      EXPECT_EQ(found.dim_w, expected.dim_w);
      EXPECT_EQ(found.dim_s, expected.dim_s);
      EXPECT_LT((found.projector_w - expected.projector_w).norm(), 1e-8);
      EXPECT_LT((found.projector_s - expected.projector_s).norm(), 1e-8);
    }
  }
}

TEST(CompleteFilter, GivesHousGeneratorsUpToScale) {
  const OracleCase hou = oracle_cases().front();
  const std::map<std::string, ExactGenerator> exact = exact_hou_generators();
  ASSERT_EQ(exact.size(), 6u);
  for (const auto& [name, expected] : exact) {
    SCOPED_TRACE(name);
    MatrixXd L(3, 2);
    L << hou.B.col(name[1] - '1'), hou.B.col(name[2] - '1');
    const GeometricQuotient q =
        geometric_quotient(hou.A, hou.C, no_output(L, 3), no_output(hou.B, 3));
    const PolePlacement placement = place_poles(q.A_0, q.M, {{-10.0, 0.0}});
    ASSERT_TRUE(placement.is_possible);
    const GeometricFilter filter = complete_filter(q, placement);
    // w and r may each be scaled: w by s_w, r by s_r.
    const double s_w = expected.P.row(0).dot(q.P.row(0));
    const double s_r = expected.H.row(0).dot(q.H.row(0));
    EXPECT_NEAR(std::abs(s_w), 1.0, 1e-14);
    EXPECT_NEAR(std::abs(s_r), 1.0, 1e-14);
    EXPECT_LT((s_w * q.P - expected.P).norm(), 1e-14);
    EXPECT_LT((filter.F - expected.F).norm(), 1e-13);
    EXPECT_LT((s_w * filter.E - expected.E).norm(), 1e-13);
    EXPECT_LT((s_w * q.P * hou.B - expected.G).norm(), 1e-14);
    EXPECT_LT((s_r / s_w * q.M - expected.M).norm(), 1e-14);
    EXPECT_LT((s_r * q.H - expected.H).norm(), 1e-14);
  }
}

TEST(CompleteFilter, HasTheSpectrumAskedForAndKeepsTheEquations) {
  for (const OracleCase& oracle : oracle_cases()) {
    for (const OracleResidual& expected : oracle.residuals) {
      if (expected.rows == 0) {
        continue;
      }
      SCOPED_TRACE(oracle.name);
      const Index q = oracle.C.rows();
      MatrixXd L(oracle.A.rows(), std::ssize(expected.ignores));
      for (Index i = 0; i < L.cols(); ++i) {
        L.col(i) = oracle.B.col(static_cast<Index>(expected.ignores[static_cast<std::size_t>(i)]));
      }
      Directions ignored{MatrixXd::Zero(L.rows(), L.cols() + oracle.Df.cols()),
                         MatrixXd::Zero(q, L.cols() + oracle.Df.cols())};
      ignored.state.leftCols(L.cols()) = L;
      ignored.output.rightCols(oracle.Df.cols()) = oracle.Df;
      const GeometricQuotient quotient =
          geometric_quotient(oracle.A, oracle.C, ignored, no_output(oracle.B, q));
      EXPECT_EQ(quotient.P.rows(), expected.quotient_dim);
      EXPECT_EQ(quotient.H.rows(), expected.rows);
      const std::vector<std::complex<double>> poles(oracle.poles.begin(),
                                                    oracle.poles.begin() + quotient.P.rows());
      const PolePlacement placement = place_poles(quotient.A_0, quotient.M, poles);
      ASSERT_TRUE(placement.is_possible) << placement.reason;
      const GeometricFilter filter = complete_filter(quotient, placement);
      const MatrixXd left = filter.F * quotient.P;
      const MatrixXd right = quotient.P * oracle.A + filter.E * oracle.C;
      EXPECT_LT((left - right).norm(), 1e-10 * (1.0 + filter.E.norm() * oracle.C.norm()));
      EXPECT_LT((filter.E * oracle.Df).norm(), 1e-10 * (1.0 + filter.E.norm()));
      EXPECT_LT((quotient.H * oracle.Df).norm(), 1e-10);
      std::vector<std::complex<double>> wanted = poles;  // real, all of them
      std::sort(wanted.begin(), wanted.end(),
                [](const auto& a, const auto& b) { return a.real() < b.real(); });
      const std::vector<std::complex<double>> spectrum = sorted_eigenvalues(filter.F);
      for (std::size_t i = 0; i < wanted.size(); ++i) {
        EXPECT_LT(std::abs(spectrum[i] - wanted[i]), 1e-8);
      }
    }
  }
}

}  // namespace
}  // namespace faultline

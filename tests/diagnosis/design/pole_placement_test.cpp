#include "diagnosis/design/pole_placement.h"

#include <algorithm>
#include <random>

#include <gtest/gtest.h>

#include "tests/support/eigenvalues.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Poles = std::vector<std::complex<double>>;

/// Largest distance between the poles and the eigenvalues of F, matched in order.
double spectrum_error(const MatrixXd& F, Poles poles) {
  Poles found = sorted_eigenvalues(F);
  const auto less = [](const auto& a, const auto& b) {
    return std::pair(std::round(1e4 * a.real()), a.imag()) <
           std::pair(std::round(1e4 * b.real()), b.imag());
  };
  std::sort(found.begin(), found.end(), less);
  std::sort(poles.begin(), poles.end(), less);
  double error = 0.0;
  for (std::size_t i = 0; i < poles.size(); ++i) {
    error = std::max(error, std::abs(found[i] - poles[i]));
  }
  return error;
}

MatrixXd placed(const MatrixXd& A_0, const MatrixXd& M, const PolePlacement& placement) {
  return A_0 + placement.D_1 * M;
}

TEST(PlacePoles, GivesTheExactSpectrumToRandomSystems) {
  const std::uint64_t seed = test_seed(30);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> normal;
  const auto random = [&](Index rows, Index cols) -> MatrixXd {
    return MatrixXd::NullaryExpr(rows, cols, [&] { return normal(engine); });
  };
  for (int trial = 0; trial < 60; ++trial) {
    const Index d = 1 + trial % 6;
    const Index rows = 1 + trial % 3;
    const MatrixXd A_0 = random(d, d);
    const MatrixXd M = random(rows, d);
    Poles poles;
    for (Index i = 0; i < d; ++i) {
      poles.emplace_back(-1.0 - 0.5 * static_cast<double>(i));
    }
    const PolePlacement placement = place_poles(A_0, M, poles);
    ASSERT_TRUE(placement.is_possible) << placement.reason;
    EXPECT_LT(spectrum_error(placed(A_0, M, placement), poles), 1e-9 * placement.condition)
        << "order " << d << ", rows " << rows;
  }
}

TEST(PlacePoles, GivesComplexPairs) {
  const MatrixXd A_0 =
      (MatrixXd(4, 4) << 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 2, 3, 4).finished();
  const MatrixXd M = (MatrixXd(2, 4) << 1, 0, 0, 0, 0, 0, 1, 0).finished();
  const Poles poles = {{-1.0, 2.0}, {-1.0, -2.0}, {-3.0, 1.0}, {-3.0, -1.0}};
  const PolePlacement placement = place_poles(A_0, M, poles);
  ASSERT_TRUE(placement.is_possible) << placement.reason;
  EXPECT_LT(spectrum_error(placed(A_0, M, placement), poles), 1e-10);
}

TEST(PlacePoles, RepeatsAPoleAsOftenAsThereAreRows) {
  const MatrixXd A_0 = (MatrixXd(3, 3) << 1, 2, 0, 0, -1, 1, 3, 0, 2).finished();
  const MatrixXd M = (MatrixXd(2, 3) << 1, 0, 0, 0, 1, 0).finished();
  const Poles poles = {-2.0, -2.0, -5.0};
  const PolePlacement placement = place_poles(A_0, M, poles);
  ASSERT_TRUE(placement.is_possible) << placement.reason;
  EXPECT_LT(spectrum_error(placed(A_0, M, placement), poles), 1e-9);
}

TEST(PlacePoles, SaysHowManyDifferentPolesAreNeeded) {
  const MatrixXd A_0 = MatrixXd::Identity(3, 3).colwise().reverse();
  const MatrixXd M = (MatrixXd(1, 3) << 1, 2, 3).finished();
  const PolePlacement placement = place_poles(A_0, M, Poles(3, {-2.0, 0.0}));
  EXPECT_FALSE(placement.is_possible);
  EXPECT_NE(placement.reason.find("at least 3 different poles"), std::string::npos)
      << placement.reason;
}

TEST(PlacePoles, RefusesRepetitionsThatTheObservabilityIndicesForbid) {
  // Indices (3, 1): of {a, a, b, b} the larger chain cannot have fewer than three different ones.
  MatrixXd A_0 = MatrixXd::Zero(4, 4);
  A_0(0, 1) = 1.0;
  A_0(1, 2) = 1.0;
  const MatrixXd M = (MatrixXd(2, 4) << 1, 0, 0, 0, 0, 0, 0, 1).finished();
  EXPECT_FALSE(place_poles(A_0, M, {-1.0, -1.0, -2.0, -2.0}).is_possible);
  EXPECT_TRUE(place_poles(A_0, M, {-1.0, -1.0, -2.0, -3.0}).is_possible);
}

TEST(PlacePoles, OfAnEmptySystemIsEmpty) {
  const PolePlacement placement = place_poles(MatrixXd(0, 0), MatrixXd(1, 0), {});
  EXPECT_TRUE(placement.is_possible);
  EXPECT_EQ(placement.D_1.rows(), 0);
  EXPECT_EQ(placement.D_1.cols(), 1);
}

}  // namespace
}  // namespace faultline

#include "diagnosis/certify/ordered_schur.h"

#include <complex>
#include <random>

#include <gtest/gtest.h>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

TEST(ComplexSchur, SortsEigenvaluesAndKeepsTheMatrix) {
  const std::uint64_t seed = test_seed(6);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> normal;
  for (Index n = 0; n < 9; ++n) {
    const MatrixXd A = MatrixXd::NullaryExpr(n, n, [&] { return normal(engine); });
    ComplexTriangle triangle = complex_schur(A);
    sort_triangle(triangle, [](std::complex<double> value) { return -std::abs(value); });
    const MatrixXcd& T = triangle.T;
    for (Index i = 0; i + 1 < n; ++i) {
      EXPECT_GE(std::abs(T(i, i)), std::abs(T(i + 1, i + 1)) - 1e-12);
      EXPECT_EQ(T.col(i).tail(n - i - 1).norm(), 0.0);
    }
    EXPECT_LT((triangle.U * T * triangle.U.adjoint() - A).norm(), 1e-12);
    EXPECT_LT((triangle.U.adjoint() * triangle.U - MatrixXcd::Identity(n, n)).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace faultline

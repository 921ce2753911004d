#include "diagnosis/bank/bank.h"

#include <limits>

#include <gtest/gtest.h>

namespace faultline {
namespace {

TEST(FaultSetCount, SumsTheBinomials) {
  EXPECT_EQ(fault_set_count(4, 2), 11u);
  EXPECT_EQ(fault_set_count(4, 4), 16u);
  EXPECT_EQ(fault_set_count(4, 9), 16u);
  EXPECT_EQ(fault_set_count(0, 3), 1u);
}

TEST(FaultSetCount, SaturatesInsteadOfOverflowing) {
  EXPECT_EQ(fault_set_count(1000, 500), std::numeric_limits<std::size_t>::max());
}

TEST(SpectralRadius, IsTheLargestEigenvalueInMagnitude) {
  const Eigen::MatrixXd F = (Eigen::MatrixXd(2, 2) << 0.3, 0.4, -0.4, 0.3).finished();
  EXPECT_NEAR(spectral_radius(F), 0.5, 1e-15);
  EXPECT_EQ(spectral_radius(Eigen::MatrixXd(0, 0)), 0.0);
}

TEST(Bank, CountsTheRowsOfAllResiduals) {
  Bank bank;
  bank.filters.resize(2);
  bank.filters[0].H.resize(1, 3);
  bank.filters[1].H.resize(2, 3);
  EXPECT_EQ(bank.residual_rows(), 3);
}

}  // namespace
}  // namespace faultline

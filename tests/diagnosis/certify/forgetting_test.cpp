#include "diagnosis/certify/forgetting.h"

#include <gtest/gtest.h>

#include "tests/diagnosis/certify/certify_cases.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// ‖M F^(i-1)‖ ρ < 0.01 τ for all i > j, counted out.
std::uint32_t counted(const PlantModel& plant, const ResidualFilter& filter, std::uint32_t until) {
  const VectorXd sample =
      filter.E.cwiseAbs() * plant.output_range + filter.G.cwiseAbs() * plant.input_range;
  const double rho = std::max(100.0, sample.norm());
  std::uint32_t last = 0;
  MatrixXd power = MatrixXd::Identity(filter.F.rows(), filter.F.cols());
  for (std::uint32_t i = 1; i < until; ++i) {
    last = (filter.M * power).norm() * rho >= 0.01 * filter.threshold ? i : last;
    power = (power * filter.F).eval();
  }
  return last + 1;
}

TEST(SamplesToForget, AreCountedOut) {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const CertifyCase random = random_case(test_seed(seed), 7, 3, 5, 1, DesignDomain::kSampled);
    for (const ResidualFilter& filter : random.designed().filters) {
      const std::uint32_t samples = samples_to_forget(random.plant, filter);
      EXPECT_EQ(samples, counted(random.plant, filter, 5 * samples));
    }
  }
}

TEST(SamplesToForget, IsInClosedFormForHou) {
  // 100 · 10 e^(-0.1 (i-1)) < 5e-4: i - 1 > 145.09, and the bad sample itself.
  const Bank bank = hou_bank();
  EXPECT_EQ(samples_to_forget(hou_plant(), bank.filters[1]), 147u);
}

TEST(SamplesToForget, FollowsAResidualThatRisesBeforeItFalls) {
  ResidualFilter filter;
  filter.F = (MatrixXd(2, 2) << 0.5, 1e6, 0.0, 0.5).finished();
  filter.M = (MatrixXd(1, 2) << 1e-5, 0.0).finished();  // 0.001 at once, far more one sample later
  filter.E = MatrixXd::Zero(2, 3);
  filter.G = MatrixXd::Zero(2, 4);
  filter.threshold = 100.0;
  const std::uint32_t samples = samples_to_forget(hou_plant(), filter);
  EXPECT_EQ(samples, counted(hou_plant(), filter, 1000));
  EXPECT_GT(samples, 5u);
}

TEST(SamplesToForget, IsOneWithoutMemory) {
  ResidualFilter filter;
  filter.F = MatrixXd(0, 0);
  filter.M = MatrixXd(1, 0);
  filter.E = MatrixXd(0, 3);
  filter.G = MatrixXd(0, 4);
  filter.threshold = 1.0;
  EXPECT_EQ(samples_to_forget(hou_plant(), filter), 1u);
}

TEST(SamplesToForget, EndsAtAMillion) {
  ResidualFilter filter;
  filter.F = MatrixXd::Constant(1, 1, 1.0 - 1e-9);
  filter.M = MatrixXd::Ones(1, 1);
  filter.E = MatrixXd::Zero(1, 3);
  filter.G = MatrixXd::Zero(1, 4);
  filter.threshold = 1.0;
  EXPECT_EQ(samples_to_forget(hou_plant(), filter), 1'000'000u);
}

}  // namespace
}  // namespace faultline

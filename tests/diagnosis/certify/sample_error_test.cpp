#include "diagnosis/certify/sample_error.h"

#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

TEST(SampleErrorGain, IsTheL1NormInClosedForm) {
  ResidualFilter filter;
  filter.F = MatrixXd::Constant(1, 1, 0.5);
  filter.E = MatrixXd::Constant(1, 1, -3.0);
  filter.G = MatrixXd::Constant(1, 1, 4.0);
  filter.M = MatrixXd::Constant(1, 1, 2.0);
  filter.H = MatrixXd::Constant(1, 1, -1.0);
  filter.K = MatrixXd::Constant(1, 1, 0.25);
  const SampleErrorGain gain = sample_error_gain(filter);
  EXPECT_NEAR(gain.output(0, 0), 1.0 + 2.0 * 3.0 / (1.0 - 0.5), 2e-5);
  EXPECT_NEAR(gain.input(0, 0), 0.25 + 2.0 * 4.0 / (1.0 - 0.5), 2e-5);
}

TEST(SampleErrorGain, IsAttainedByTheWorstCourseOfErrors) {
  for (const ResidualFilter& filter : hou_bank().filters) {
    const SampleErrorGain gain = sample_error_gain(filter);
    // The worst course ends with the signs of the impulse response, backwards in time.
    const int samples = 400;
    std::vector<VectorXd> response = {-filter.H.row(0)};
    MatrixXd left = filter.M;
    for (int k = 1; k < samples; ++k) {
      response.emplace_back(-(left * filter.E).row(0));
      left = (left * filter.F).eval();
    }
    VectorXd v = VectorXd::Zero(filter.F.rows());
    double r = 0.0;
    for (int k = samples - 1; k >= 0; --k) {
      const VectorXd y = response[static_cast<std::size_t>(k)].array().sign();
      r = (filter.M * v - filter.H * y)(0);
      v = (filter.F * v - filter.E * y).eval();
    }
    EXPECT_NEAR(r, gain.output.row(0).sum(), 1e-5 * r) << filter.name;
  }
}

TEST(SampleErrorGain, OfAFilterWithoutStateIsItsFeedthrough) {
  ResidualFilter filter;
  filter.F.resize(0, 0);
  filter.E.resize(0, 2);
  filter.G.resize(0, 1);
  filter.M.resize(1, 0);
  filter.H = (MatrixXd(1, 2) << 1.0, -2.0).finished();
  filter.K = MatrixXd::Zero(1, 1);
  EXPECT_EQ(sample_error_gain(filter).output, filter.H.cwiseAbs());
}

TEST(SampleErrorGain, RefusesAFilterThatDoesNotForget) {
  ResidualFilter filter = hou_bank().filters[0];
  filter.F(0, 0) = 1.0;
  EXPECT_THROW(static_cast<void>(sample_error_gain(filter)), std::invalid_argument);
}

}  // namespace
}  // namespace faultline

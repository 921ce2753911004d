#include "diagnosis/design/residual_response.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include <Eigen/LU>

namespace faultline {
namespace {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;

// A DC gain below this fraction of what its terms could add up to is a zero at DC: rounding errors
// stay below 1e-12 of it, and a gain of 1e-9 of the possible could not be told from zero in use.
constexpr double kZeroGain = 1e-9;
// Grid of the peak search: points per decade, over the decades around the filter's own rates.
constexpr int kPointsPerDecade = 20;
constexpr int kDecades = 8;
constexpr int kSampledPoints = 512;

double gain_at(const ResidualResponse& response, std::complex<double> lambda) {
  const auto d = response.F.rows();
  VectorXcd r = response.h.cast<std::complex<double>>();
  if (d > 0) {
    const MatrixXcd pencil = lambda * MatrixXcd::Identity(d, d) - response.F;
    r += response.M * pencil.partialPivLu().solve(response.b.cast<std::complex<double>>());
  }
  return r.norm();
}

}  // namespace

double dc_gain(const ResidualResponse& response) {
  const auto d = response.F.rows();
  if (d == 0) {
    return response.h.norm();
  }
  const MatrixXd pencil = (response.is_sampled ? 1.0 : 0.0) * MatrixXd::Identity(d, d) - response.F;
  const VectorXd w = pencil.partialPivLu().solve(response.b);
  const double gain = (response.M * w + response.h).norm();
  const double possible = response.M.norm() * w.norm() + response.h.norm();
  return gain > kZeroGain * possible ? gain : 0.0;
}

double peak_gain(const ResidualResponse& response) {
  double peak = 0.0;
  if (response.is_sampled) {
    for (int i = 0; i <= kSampledPoints; ++i) {
      peak =
          std::max(peak, gain_at(response, std::polar(1.0, std::numbers::pi * i / kSampledPoints)));
    }
    return peak;
  }
  const double rate = response.F.size() == 0 ? 1.0 : response.F.norm();
  for (int i = 0; i <= kDecades * kPointsPerDecade; ++i) {
    const double decade = static_cast<double>(i) / kPointsPerDecade - 0.5 * kDecades;
    peak = std::max(peak, gain_at(response, {0.0, rate * std::pow(10.0, decade)}));
  }
  return peak;
}

}  // namespace faultline

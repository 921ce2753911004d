#include "diagnosis/certify/sample_error.h"

#include <stdexcept>

#include <fmt/format.h>

namespace faultline {
namespace {

using Eigen::MatrixXd;

constexpr double kNegligible = 1e-6;
constexpr int kMaxDoublings = 24;  // 16 million samples
constexpr long kMaxSamples = 10'000'000;

[[noreturn]] void refuse(const ResidualFilter& filter) {
  throw std::invalid_argument(
      fmt::format("{}: its filter is not stable, or forgets too slowly", filter.name));
}

// An upper bound of Σ_k ‖F^k‖: with t = 2^s the first for which ‖F^t‖ < 1/2, the powers up to t
// are bounded by the products of those of the binary digits, and the rest is a geometric series.
double power_sum_bound(const ResidualFilter& filter) {
  double largest = 1.0;
  double t = 1.0;
  MatrixXd power = filter.F;
  for (int s = 0; s < kMaxDoublings; ++s) {
    const double norm = power.norm();
    if (norm < 0.5) {
      return 2.0 * t * largest;
    }
    largest *= std::max(1.0, norm);
    power = (power * power).eval();
    t *= 2.0;
  }
  refuse(filter);
}

}  // namespace

SampleErrorGain sample_error_gain(const ResidualFilter& filter) {
  SampleErrorGain gain{filter.H.cwiseAbs(), filter.K.cwiseAbs()};
  if (filter.F.rows() == 0) {
    return gain;
  }
  const double rest_per_norm = power_sum_bound(filter) * (filter.E.norm() + filter.G.norm());
  MatrixXd left = filter.M;  // M F^k
  for (long k = 0; k < kMaxSamples; ++k) {
    if (left.norm() * rest_per_norm <= kNegligible * (gain.output.norm() + gain.input.norm())) {
      return gain;
    }
    gain.output += (left * filter.E).cwiseAbs();
    gain.input += (left * filter.G).cwiseAbs();
    left = (left * filter.F).eval();
  }
  refuse(filter);
}

}  // namespace faultline

#include "diagnosis/certify/sample_error.h"

#include <optional>
#include <stdexcept>

#include <fmt/format.h>

#include "diagnosis/certify/power_bound.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;

constexpr double kNegligible = 1e-6;
constexpr long kMaxSamples = 10'000'000;

[[noreturn]] void refuse(const ResidualFilter& filter) {
  throw std::invalid_argument(
      fmt::format("{}: its filter is not stable, or forgets too slowly", filter.name));
}

}  // namespace

SampleErrorGain sample_error_gain(const ResidualFilter& filter) {
  SampleErrorGain gain{filter.H.cwiseAbs(), filter.K.cwiseAbs()};
  if (filter.F.rows() == 0) {
    return gain;
  }
  const std::optional<double> power_sum = power_sum_bound(filter.F);
  if (!power_sum) {
    refuse(filter);
  }
  const double rest_per_norm = *power_sum * (filter.E.norm() + filter.G.norm());
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

#include "diagnosis/certify/forgetting.h"

#include <algorithm>
#include <initializer_list>

#include "diagnosis/certify/power_bound.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kForgottenPart = 0.01;
constexpr std::uint32_t kLongest = 1'000'000;

double largest_of(const VectorXd& values) { return values.size() == 0 ? 0.0 : values.maxCoeff(); }

}  // namespace

std::uint32_t samples_to_forget(const PlantModel& plant, const ResidualFilter& filter,
                                double threshold_factor) {
  VectorXd bad_sample = filter.E.cwiseAbs() * plant.output_range;
  bad_sample += filter.G.cwiseAbs() * plant.input_range;
  const double error =
      std::max({largest_of(plant.output_range), largest_of(plant.input_range), bad_sample.norm()});
  const double forgotten = kForgottenPart * threshold_factor * filter.threshold;
  const double bound = largest_power(filter.F);
  MatrixXd seen = filter.M;  // M F^(i-1)
  std::uint32_t last = 0;    // i of the last sample at which it is not forgotten
  for (std::uint32_t i = 1; i < kLongest; ++i) {
    if (seen.norm() * error >= forgotten) {
      last = i;
    } else if (seen.norm() * bound * error < forgotten) {
      return last + 1;
    }
    seen = (seen * filter.F).eval();
  }
  return kLongest;
}

}  // namespace faultline

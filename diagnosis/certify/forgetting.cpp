#include "diagnosis/certify/forgetting.h"

#include <algorithm>
#include <initializer_list>

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kForgottenPart = 0.01;
constexpr std::uint32_t kLongest = 1'000'000;
// F^(2^20) is beyond the longest time.
constexpr int kMostSquarings = 20;

// A bound of ‖F^i‖_F over all i: F^(2^s) is a contraction from some s on, and every power below it
// is a product of squares.
double largest_power(const MatrixXd& F) {
  MatrixXd power = F;
  double bound = std::max(1.0, MatrixXd::Identity(F.rows(), F.cols()).norm());
  for (int s = 0; s < kMostSquarings && power.norm() >= 1.0; ++s) {
    bound *= std::max(1.0, power.norm());
    power = (power * power).eval();
  }
  return bound;
}

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

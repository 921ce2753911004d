#include "diagnosis/design/implementation_form.h"

#include <algorithm>

#include "diagnosis/model/discretize.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A bad sample is forgotten when what is left of it stays below this part of the threshold.
constexpr double kForgotten = 0.01;
// Longest time a bad sample may be distrusted; a filter slower than that is distrusted this long
// (at 1 kHz a quarter of an hour).
constexpr std::uint32_t kMaxForgetSamples = 1'000'000;

// An upper bound of max_i ‖F^i‖, from the binary digits of i: the powers shrink from the first
// ‖F^(2^s)‖ < 1 on.
double largest_power_bound(const MatrixXd& F) {
  constexpr int kMaxDoublings = 64;  // F is stable, if only by rounding
  double bound = 1.0;
  MatrixXd power = F;
  for (int s = 0; s < kMaxDoublings; ++s) {
    const double norm = power.norm();
    if (norm < 1.0) {
      break;
    }
    bound *= norm;
    power = (power * power).eval();
  }
  return bound;
}

}  // namespace

void implement(const DesignModel& model, const DesignedFilter& designed, double sample_time_s,
               double factor, ResidualFilter& filter) {
  filter.M = factor * designed.M;
  filter.H = factor * designed.H;
  if (model.is_sampled) {
    filter.F = designed.F;
    filter.E = designed.E;
    filter.G = designed.G;
    filter.L = designed.P * model.faults.state;
  } else {
    const FirstOrderHoldSystem y_path = discretize_foh(designed.F, designed.E, sample_time_s);
    filter.F = y_path.A;
    filter.E = y_path.B_0 + y_path.A * y_path.B_1;
    filter.G = discretize_zoh(designed.F, designed.G, sample_time_s).B;
    filter.H += filter.M * y_path.B_1;
    filter.L = discretize_zoh(designed.F, designed.P * model.faults.state, sample_time_s).B;
  }
  filter.L += filter.E * model.faults.output;
  filter.J = filter.H * model.faults.output;
  filter.G += filter.E * model.D;
  filter.K = filter.H * model.D;
}

std::uint32_t forget_samples(const PlantModel& plant, const ResidualFilter& filter) {
  const VectorXd bad_sample =
      filter.E.cwiseAbs() * plant.output_range + filter.G.cwiseAbs() * plant.input_range;
  double largest_range = plant.output_range.maxCoeff();
  if (plant.input_range.size() > 0) {
    largest_range = std::max(largest_range, plant.input_range.maxCoeff());
  }
  const double rho = std::max(largest_range, bad_sample.norm());
  const double forgotten = kForgotten * filter.threshold / rho;
  const double bound = largest_power_bound(filter.F);
  MatrixXd left = filter.M;  // M F^i of what is left after i samples
  std::uint32_t first = 1;   // the bad sample itself
  for (std::uint32_t i = 1; i < kMaxForgetSamples; ++i) {
    const double size = left.norm();
    if (size >= forgotten) {
      first = i + 1;
    } else if (size * bound < forgotten) {
      return first;
    }
    left = (left * filter.F).eval();
  }
  return kMaxForgetSamples;
}

}  // namespace faultline

#include "diagnosis/certify/plant_step.h"

#include <stdexcept>
#include <utility>

#include <fmt/format.h>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

void check_finite(const PlantModel& plant, const Bank& bank, const MatrixXd& A, const MatrixXd& B) {
  if (!A.allFinite() || !B.allFinite()) {
    throw std::invalid_argument(
        fmt::format("plant \"{}\" sampled every {:g} s has numbers that are not finite: its "
                    "entries differ too much in size, or it is too unstable for that sample time",
                    plant.name, bank.sample_time_s));
  }
}

SampledSystem step_of(const PlantModel& plant, const Bank& bank, MatrixXd A, MatrixXd B) {
  if (plant.time == TimeDomain::kDiscrete) {
    return {std::move(A), std::move(B)};
  }
  if (bank.domain == DesignDomain::kEuler) {
    return {MatrixXd::Identity(A.rows(), A.cols()) + A * bank.sample_time_s,
            B * bank.sample_time_s};
  }
  return discretize_zoh(A, B, bank.sample_time_s);
}

}  // namespace

SampledSystem plant_step(const PlantModel& plant, const Bank& bank, const MatrixXd& inputs,
                         const VectorXd& scales) {
  if (plant.time == TimeDomain::kDiscrete &&
      plant.sample_time_s.value_or(0.0) != bank.sample_time_s) {
    throw std::invalid_argument(
        fmt::format("the bank's sample time is {:g} s, expected the discrete plant's own, {:g} s",
                    bank.sample_time_s, plant.sample_time_s.value_or(0.0)));
  }
  const bool has_middle_slopes = bank.method == "uio" && !plant.nonlinearities.empty();
  const Index terms = has_middle_slopes ? std::ssize(plant.nonlinearities) : 0;
  MatrixXd columns(inputs.rows(), inputs.cols() + terms);
  columns.leftCols(inputs.cols()) = inputs;
  for (Index i = 0; i < terms; ++i) {
    columns.col(inputs.cols() + i) = plant.nonlinearities[static_cast<std::size_t>(i)].E_o;
  }
  const VectorXd inverse = scales.cwiseInverse();
  MatrixXd A = inverse.asDiagonal() * plant.A * scales.asDiagonal();
  MatrixXd B = inverse.asDiagonal() * columns;
  check_finite(plant, bank, A, B);
  SampledSystem result = step_of(plant, bank, std::move(A), std::move(B));
  for (Index i = 0; i < terms; ++i) {
    const Nonlinearity& term = plant.nonlinearities[static_cast<std::size_t>(i)];
    const double middle = term.gain * 0.5 * (term.slope_min + term.slope_max);
    const VectorXd E_i = term.E_i.cwiseProduct(scales);
    result.A += middle * result.B.col(inputs.cols() + i) * E_i.transpose();
  }
  result.B = result.B.leftCols(inputs.cols()).eval();
  check_finite(plant, bank, result.A, result.B);
  return result;
}

}  // namespace faultline

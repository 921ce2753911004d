#include "sim/plant.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "diagnosis/model/discretize.h"

namespace faultline {
namespace {

struct ComponentDirections {
  Eigen::MatrixXd state;   // n × components
  Eigen::MatrixXd output;  // q × components
};

ComponentDirections component_directions(const PlantModel& model) {
  const auto count = std::count_if(model.faults.begin(), model.faults.end(),
                                   [](const Fault& f) { return f.kind == FaultKind::kComponent; });
  ComponentDirections directions{Eigen::MatrixXd(model.n(), count),
                                 Eigen::MatrixXd(model.q(), count)};
  Eigen::Index column = 0;
  for (const Fault& fault : model.faults) {
    if (fault.kind != FaultKind::kComponent) continue;
    directions.state.col(column) = fault.state;
    directions.output.col(column) = fault.output;
    ++column;
  }
  return directions;
}

void check_sample_time(const PlantModel& model, double sample_time_s) {
  if (!(sample_time_s > 0.0)) {
    throw std::invalid_argument(
        fmt::format("sample time: found {} s, expected a positive number", sample_time_s));
  }
  if (model.time == TimeDomain::kDiscrete && *model.sample_time_s != sample_time_s) {
    throw std::invalid_argument(
        fmt::format("sample time: found {} s, expected {} s, that of the discrete plant \"{}\"",
                    sample_time_s, *model.sample_time_s, model.name));
  }
}

}  // namespace

LinearPlant::LinearPlant(const PlantModel& model, double sample_time_s)
    : C_(model.C),
      D_(model.D),
      x_operating_(model.x_operating),
      u_operating_(model.u_operating),
      y_operating_(model.y_operating),
      dx_(Eigen::VectorXd::Zero(model.n())),
      dx_next_(model.n()),
      du_(model.m()),
      dy_(model.q()),
      x_absolute_(model.x_operating) {
  check_sample_time(model, sample_time_s);
  if (!model.nonlinearities.empty()) {
    throw std::invalid_argument(fmt::format(
        "plant \"{}\": found {} nonlinearities, expected none: this simulator steps linear plants",
        model.name, model.nonlinearities.size()));
  }
  const ComponentDirections directions = component_directions(model);
  D_m_ = directions.output;
  if (model.time == TimeDomain::kDiscrete) {
    A_ = model.A;
    B_ = model.B;
    L_ = directions.state;
    return;
  }
  Eigen::MatrixXd inputs(model.n(), model.m() + directions.state.cols());
  inputs << model.B, directions.state;
  const SampledSystem sampled = discretize_zoh(model.A, inputs, sample_time_s);
  A_ = sampled.A;
  B_ = sampled.B.leftCols(model.m());
  L_ = sampled.B.rightCols(directions.state.cols());
}

void LinearPlant::reset(const Eigen::VectorXd& x) noexcept {
  dx_ = x - x_operating_;
  x_absolute_ = x;
}

void LinearPlant::actuate(std::span<const double> u, const ActiveFaults& faults) noexcept {
  for (Eigen::Index j = 0; j < du_.size(); ++j) {
    du_[j] = faults.input_gain[j] * u[static_cast<std::size_t>(j)] + faults.input_bias[j] -
             u_operating_[j];
  }
}

void LinearPlant::measure(std::span<const double> u, const ActiveFaults& faults,
                          std::span<double> y) noexcept {
  actuate(u, faults);
  dy_.noalias() = C_ * dx_;
  dy_.noalias() += D_ * du_;
  dy_.noalias() += D_m_ * faults.component;
  for (Eigen::Index i = 0; i < dy_.size(); ++i) {
    y[static_cast<std::size_t>(i)] =
        faults.output_gain[i] * (dy_[i] + y_operating_[i]) + faults.output_bias[i];
  }
}

void LinearPlant::step(std::span<const double> u, const ActiveFaults& faults) noexcept {
  actuate(u, faults);
  dx_next_.noalias() = A_ * dx_;
  dx_next_.noalias() += B_ * du_;
  dx_next_.noalias() += L_ * faults.component;
  dx_.swap(dx_next_);
  x_absolute_ = dx_ + x_operating_;
}

}  // namespace faultline

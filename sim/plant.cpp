#include "sim/plant.h"

#include <stdexcept>

#include <fmt/format.h>

namespace faultline {
namespace {

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

SimulatedPlant::SimulatedPlant(const PlantModel& model, double sample_time_s,
                               const Integration& integration)
    : dynamics_(own_dynamics(model)),
      outputs_(own_outputs(model)),
      x_operating_(model.x_operating),
      u_operating_(model.u_operating),
      y_operating_(model.y_operating),
      dx_(Eigen::VectorXd::Zero(model.n())),
      dx_next_(model.n()),
      du_(model.m()),
      dy_(model.q()),
      phi_(std::ssize(model.nonlinearities)),
      x_absolute_(model.x_operating) {
  check_sample_time(model, sample_time_s);
  const IntegrationMethod method = method_for(model, integration);
  if (method == IntegrationMethod::kRk4) {
    rk4_.emplace(dynamics_, sample_time_s, integration.substeps);
  } else if (model.time == TimeDomain::kContinuous) {
    dynamics_ = sampled_dynamics(dynamics_, method, sample_time_s);
  }
}

void SimulatedPlant::reset(const Eigen::VectorXd& x) noexcept {
  dx_ = x - x_operating_;
  x_absolute_ = x;
}

void SimulatedPlant::actuate(std::span<const double> u, const ActiveFaults& faults) noexcept {
  for (Eigen::Index j = 0; j < du_.size(); ++j) {
    du_[j] = faults.input_gain[j] * u[static_cast<std::size_t>(j)] + faults.input_bias[j] -
             u_operating_[j];
  }
}

void SimulatedPlant::measure(std::span<const double> u, const ActiveFaults& faults,
                             const ActivePerturbations& perturbations,
                             std::span<double> y) noexcept {
  actuate(u, faults);
  dy_.noalias() = outputs_.C * dx_;
  dy_.noalias() += outputs_.D * du_;
  dy_.noalias() += outputs_.D_m * faults.component;
  if (perturbations.disturbance.size() > 0)
    dy_.noalias() += outputs_.D_f * perturbations.disturbance;
  if (perturbations.noise.size() > 0) dy_.noalias() += outputs_.F * perturbations.noise;
  for (Eigen::Index i = 0; i < dy_.size(); ++i) {
    y[static_cast<std::size_t>(i)] =
        faults.output_gain[i] * (dy_[i] + y_operating_[i]) + faults.output_bias[i];
  }
}

void SimulatedPlant::step(std::span<const double> u, const ActiveFaults& faults,
                          const ActivePerturbations& perturbations) noexcept {
  actuate(u, faults);
  if (rk4_) {
    dx_next_.setZero();
  } else {
    dx_next_.noalias() = dynamics_.A * dx_;
  }
  dx_next_.noalias() += dynamics_.B * du_;
  dx_next_.noalias() += dynamics_.L * faults.component;
  if (perturbations.disturbance.size() > 0) {
    dx_next_.noalias() += dynamics_.E * perturbations.disturbance;
  }
  if (rk4_) {
    rk4_->step(dx_next_, dx_);
  } else {
    if (phi_.size() > 0) {
      dynamics_.evaluate_nonlinearities(dx_, phi_);
      dx_next_.noalias() += dynamics_.Phi * phi_;
    }
    dx_.swap(dx_next_);
  }
  x_absolute_ = dx_ + x_operating_;
}

}  // namespace faultline

#include "sim/model_plant.h"

#include <cmath>
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

ModelPlant::ModelPlant(const PlantModel& model, double sample_time_s,
                       const Integration& integration)
    : dynamics_(own_dynamics(model)),
      outputs_(own_outputs(model)),
      state_names_(model.state_names),
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
  for (const Fault& fault : model.faults) {
    if (fault.kind == FaultKind::kComponent) components_.push_back({fault.name, 0.0});
  }
  const IntegrationMethod method = method_for(model, integration);
  if (method == IntegrationMethod::kRk4 || method == IntegrationMethod::kDormandPrince) {
    const HeldEquations equations{.state_count = static_cast<std::size_t>(model.n()),
                                  .derivative = &ModelPlant::derivative};
    integrator_ = make_integrator(equations, sample_time_s, method, integration);
  } else if (model.time == TimeDomain::kContinuous) {
    dynamics_ = sampled_dynamics(dynamics_, method, sample_time_s);
  }
}

void ModelPlant::reset(const Eigen::VectorXd& x) noexcept {
  dx_ = x - x_operating_;
  x_absolute_ = x;
  result_ = {};
}

// x' = A x + Φ φ(E_i x) + what is held over the sample, in dx_next_.
void ModelPlant::derivative(void* self, const double* x, double* dx) {
  ModelPlant& plant = *static_cast<ModelPlant*>(self);
  const Eigen::Map<const Eigen::VectorXd> state(x, plant.dx_.size());
  Eigen::Map<Eigen::VectorXd> slope(dx, plant.dx_.size());
  slope = plant.dx_next_;
  slope.noalias() += plant.dynamics_.A * state;
  plant.dynamics_.evaluate_nonlinearities(state, plant.phi_);
  slope.noalias() += plant.dynamics_.Phi * plant.phi_;
}

void ModelPlant::take(std::span<const double> u) noexcept {
  du_ = Eigen::Map<const Eigen::VectorXd>(u.data(), du_.size()) - u_operating_;
}

void ModelPlant::measure(const PlantDrive& drive, std::span<double> y) noexcept {
  const auto& [u, component, perturbations] = drive;
  take(u);
  dy_.noalias() = outputs_.C * dx_;
  dy_.noalias() += outputs_.D * du_;
  dy_.noalias() +=
      outputs_.D_m * Eigen::Map<const Eigen::VectorXd>(component.data(), outputs_.D_m.cols());
  if (perturbations.disturbance.size() > 0)
    dy_.noalias() += outputs_.D_f * perturbations.disturbance;
  if (perturbations.noise.size() > 0) dy_.noalias() += outputs_.F * perturbations.noise;
  for (Eigen::Index i = 0; i < dy_.size(); ++i) {
    y[static_cast<std::size_t>(i)] = dy_[i] + y_operating_[i];
  }
}

void ModelPlant::step(const PlantDrive& drive) noexcept {
  const auto& [u, component, perturbations] = drive;
  take(u);
  if (integrator_) {
    dx_next_.setZero();
  } else {
    dx_next_.noalias() = dynamics_.A * dx_;
  }
  dx_next_.noalias() += dynamics_.B * du_;
  dx_next_.noalias() +=
      dynamics_.L * Eigen::Map<const Eigen::VectorXd>(component.data(), dynamics_.L.cols());
  if (perturbations.disturbance.size() > 0) {
    dx_next_.noalias() += dynamics_.E * perturbations.disturbance;
  }
  if (integrator_) {
    result_ = integrator_->advance(this, dx_.data());
  } else {
    if (phi_.size() > 0) {
      dynamics_.evaluate_nonlinearities(dx_, phi_);
      dx_next_.noalias() += dynamics_.Phi * phi_;
    }
    dx_.swap(dx_next_);
  }
  x_absolute_ = dx_ + x_operating_;
}

std::string ModelPlant::failure() const {
  for (Eigen::Index i = 0; i < dx_.size(); ++i) {
    if (!std::isfinite(dx_[i])) {
      return fmt::format("{} is not finite", state_names_[static_cast<std::size_t>(i)]);
    }
  }
  return trouble_text(result_, state_names_);
}

}  // namespace faultline

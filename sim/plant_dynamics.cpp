#include "sim/plant_dynamics.h"

#include <cassert>
#include <vector>

#include "diagnosis/model/discretize.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

MatrixXd beside(const MatrixXd& left, const MatrixXd& right) {
  MatrixXd both(left.rows(), left.cols() + right.cols());
  both << left, right;
  return both;
}

std::vector<Fault> component_faults(const PlantModel& model) {
  std::vector<Fault> components;
  for (const Fault& fault : model.faults) {
    if (fault.kind == FaultKind::kComponent) components.push_back(fault);
  }
  return components;
}

// One column per entry: its `direction`, a member with `rows` numbers.
template <class Entry>
MatrixXd columns_of(const std::vector<Entry>& entries, Eigen::VectorXd Entry::*direction,
                    Index rows) {
  MatrixXd columns(rows, std::ssize(entries));
  for (Index j = 0; j < columns.cols(); ++j) {
    columns.col(j) = entries[static_cast<std::size_t>(j)].*direction;
  }
  return columns;
}

}  // namespace

void PlantDynamics::evaluate_nonlinearities(const Eigen::Ref<const Eigen::VectorXd>& x,
                                            Eigen::VectorXd& phi) const noexcept {
  phi.noalias() = E_i * x;
  for (Index i = 0; i < phi.size(); ++i) {
    phi[i] = evaluate(functions[static_cast<std::size_t>(i)], phi[i]);
  }
}

PlantDynamics own_dynamics(const PlantModel& model) {
  PlantDynamics dynamics;
  const Index n = model.n();
  dynamics.A = model.A;
  dynamics.B = model.B;
  dynamics.L = columns_of(component_faults(model), &Fault::state, n);
  dynamics.E = columns_of(model.disturbances, &Disturbance::state, n);
  const Index l = std::ssize(model.nonlinearities);
  dynamics.Phi.resize(n, l);
  dynamics.E_i.resize(l, n);
  for (Index i = 0; i < l; ++i) {
    const Nonlinearity& nonlinearity = model.nonlinearities[static_cast<std::size_t>(i)];
    dynamics.Phi.col(i) = nonlinearity.gain * nonlinearity.E_o;
    dynamics.E_i.row(i) = nonlinearity.E_i.transpose();
    dynamics.functions.push_back(nonlinearity.function);
  }
  return dynamics;
}

PlantOutputs own_outputs(const PlantModel& model) {
  return {.C = model.C,
          .D = model.D,
          .D_m = columns_of(component_faults(model), &Fault::output, model.q()),
          .D_f = columns_of(model.disturbances, &Disturbance::output, model.q()),
          .F = columns_of(model.noises, &Noise::output, model.q())};
}

PlantDynamics sampled_dynamics(const PlantDynamics& continuous, IntegrationMethod method,
                               double sample_time_s) {
  assert(method != IntegrationMethod::kRk4);
  const auto sample = [&](const MatrixXd& inputs) {
    return method == IntegrationMethod::kEuler
               ? discretize_euler(continuous.A, inputs, sample_time_s)
               : discretize_zoh(continuous.A, inputs, sample_time_s);
  };
  // Inputs and faults apart from the rest: what else acts on a plant must not change, by rounding,
  // how it answers to them.
  const Index m = continuous.B.cols();
  const Index components = continuous.L.cols();
  const SampledSystem commanded = sample(beside(continuous.B, continuous.L));
  const SampledSystem other = sample(beside(continuous.E, continuous.Phi));
  PlantDynamics sampled = continuous;
  sampled.A = commanded.A;
  sampled.B = commanded.B.leftCols(m);
  sampled.L = commanded.B.rightCols(components);
  sampled.E = other.B.leftCols(continuous.E.cols());
  sampled.Phi = other.B.rightCols(continuous.Phi.cols());
  return sampled;
}

}  // namespace faultline

#include "diagnosis/design/uio/observer_model.h"

namespace faultline {

Eigen::MatrixXd ObserverModel::vertex(Eigen::Index vertex) const {
  Eigen::VectorXd delta = slope_radius;
  for (Eigen::Index i = 0; i < delta.size(); ++i) {
    if (((vertex >> i) & 1) == 0) delta[i] = -delta[i];
  }
  return E_o * delta.asDiagonal() * E_i;
}

ObserverOutput output_error(const ObserverModel& model) { return {model.C, model.W, model.F_y}; }

ErrorDynamics error_dynamics(const ObserverModel& model, const DecouplingMatrices& decoupling,
                             const Eigen::MatrixXd& gain) {
  return {decoupling.S * model.A - gain * model.C, decoupling.S * model.M - gain * model.W,
          -decoupling.T * model.W, decoupling.S * model.F_x - gain * model.F_y};
}

}  // namespace faultline

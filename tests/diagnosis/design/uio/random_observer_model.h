#pragma once

#include <cmath>

#include <Eigen/Core>

#include "diagnosis/design/uio/observer_model.h"
#include "tests/support/random_plant.h"

namespace faultline {

/// A stable plant of n states and q outputs, of a noise per output and a disturbance, all entries
/// of about one; f faults on the states.
[[nodiscard]] inline ObserverModel random_observer_model(RandomNumbers& random, Eigen::Index n,
                                                         Eigen::Index q, Eigen::Index f) {
  ObserverModel model;
  model.A = random.normal(n, n);
  model.A *= 0.9 / model.A.norm() * std::sqrt(static_cast<double>(n) / 2.0);
  model.C = random.normal(q, n);
  model.M = Eigen::MatrixXd::Zero(n, q + 1);
  model.M.col(0) = random.normal(n, 1);
  model.W = Eigen::MatrixXd::Zero(q, q + 1);
  model.W.rightCols(q).setIdentity();
  model.w_bound = Eigen::VectorXd::Constant(q + 1, 0.01);
  model.F_x = random.normal(n, f);
  model.F_y = Eigen::MatrixXd::Zero(q, f);
  model.E_o.resize(n, 0);
  model.E_i.resize(0, n);
  model.x_bound = Eigen::VectorXd::Ones(n);
  return model;
}

/// T = 0.
[[nodiscard]] inline DecouplingMatrices no_decoupling(const ObserverModel& model) {
  return {Eigen::MatrixXd::Zero(model.n(), model.C.rows()),
          Eigen::MatrixXd::Identity(model.n(), model.n()), Eigen::MatrixXd(model.n(), 0)};
}

}  // namespace faultline

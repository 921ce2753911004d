#pragma once

#include <Eigen/Core>

namespace faultline {

/// [X Y].
[[nodiscard]] inline Eigen::MatrixXd side_by_side(const Eigen::MatrixXd& X,
                                                  const Eigen::MatrixXd& Y) {
  Eigen::MatrixXd both(X.rows(), X.cols() + Y.cols());
  both << X, Y;
  return both;
}

/// [X; Y].
[[nodiscard]] inline Eigen::MatrixXd stacked(const Eigen::MatrixXd& X, const Eigen::MatrixXd& Y) {
  Eigen::MatrixXd both(X.rows() + Y.rows(), X.cols());
  both << X, Y;
  return both;
}

/// ‖X‖_F, or 1 for a zero X: what X is measured by.
[[nodiscard]] inline double data_scale(const Eigen::MatrixXd& X) {
  const double norm = X.norm();
  return norm > 0.0 ? norm : 1.0;
}

/// X with columns of length one; zero ones stay.
[[nodiscard]] inline Eigen::MatrixXd unit_columns(const Eigen::MatrixXd& X) {
  Eigen::MatrixXd unit = X;
  for (Eigen::Index j = 0; j < X.cols(); ++j) {
    unit.col(j) /= data_scale(X.col(j));
  }
  return unit;
}

}  // namespace faultline

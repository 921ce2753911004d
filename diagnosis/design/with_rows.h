#pragma once

#include <Eigen/Core>

namespace faultline {

/// X with zero rows below it, `rows` in all: columns of a model that has got more states.
[[nodiscard]] inline Eigen::MatrixXd with_rows(const Eigen::MatrixXd& X, Eigen::Index rows) {
  Eigen::MatrixXd more = Eigen::MatrixXd::Zero(rows, X.cols());
  more.topRows(X.rows()) = X;
  return more;
}

}  // namespace faultline

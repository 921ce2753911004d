#pragma once

#include <Eigen/Core>

namespace faultline {

/// The largest eigenvalue of a symmetric matrix, at least one row; only the lower half is read.
/// Here, and not where it is used, because each use of Eigen's decompositions costs its file ten
/// seconds of compilation.
[[nodiscard]] double largest_eigenvalue(const Eigen::MatrixXd& X);

/// The smallest singular value of X, rows >= columns >= 1.
[[nodiscard]] double smallest_singular_value(const Eigen::MatrixXcd& X);

}  // namespace faultline

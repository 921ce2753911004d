#pragma once

#include <optional>

#include <Eigen/Core>

namespace faultline {

/// An upper bound of ‖F^i‖_F over all i >= 0. F stable.
[[nodiscard]] double largest_power(const Eigen::MatrixXd& F);

/// An upper bound of Σ_i ‖F^i‖_F, i >= 0; nothing if F is not stable or needs more than 16 million
/// samples to shrink to a half.
[[nodiscard]] std::optional<double> power_sum_bound(const Eigen::MatrixXd& F);

}  // namespace faultline

#pragma once

#include <Eigen/Core>

namespace faultline {

/// From one fault to a residual, in its internal form (x' is dx/dt or x_k+1):
///
///   e' = F e - b m,  r = M e - h m;   T(λ) = -(M (λ I - F)⁻¹ b + h)
///
/// F d×d stable, M rows×d, b = P L_j + E D_j (d), h = H D_j (rows).
struct ResidualResponse {
  const Eigen::MatrixXd& F;
  const Eigen::MatrixXd& M;
  Eigen::VectorXd b;
  Eigen::VectorXd h;
  bool is_sampled = false;  ///< λ on the unit circle, else on the imaginary axis
};

/// ‖T‖₂ at DC (s = 0, z = 1). Exactly 0 if it is nothing but rounding error.
[[nodiscard]] double dc_gain(const ResidualResponse& response);

/// max over frequency of ‖T‖₂, on a grid of 20 points per decade (512 on the unit circle).
[[nodiscard]] double peak_gain(const ResidualResponse& response);

}  // namespace faultline

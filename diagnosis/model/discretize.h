#pragma once

#include <Eigen/Core>

namespace faultline {

/// A_d, B_d of a sampled linear system: x_k+1 = A_d x_k + B_d u_k.
struct SampledSystem {
  Eigen::MatrixXd A;
  Eigen::MatrixXd B;
};

/// Exact sampling of x' = A x + B u with u held over each sample (zero-order hold):
///
///   [A_d B_d; 0 I] = exp([A B; 0 0]·T)
///
/// A n×n, B n×m, sample_time_s > 0.
[[nodiscard]] SampledSystem discretize_zoh(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                           double sample_time_s);

/// Sampling of x' = A x + B u by Euler's method, which is right to the first order in T only:
///
///   A_d = I + A T,  B_d = B T
///
/// A n×n, B n×m, sample_time_s > 0.
[[nodiscard]] SampledSystem discretize_euler(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                             double sample_time_s);

/// Sampling of x' = A x + B v with v linear between samples (first-order hold):
///
///   x_k+1 = A_d x_k + B_0 v_k + B_1 v_k+1
struct FirstOrderHoldSystem {
  Eigen::MatrixXd A;    ///< exp(A T)
  Eigen::MatrixXd B_0;  ///< weight of v_k
  Eigen::MatrixXd B_1;  ///< weight of v_k+1
};
[[nodiscard]] FirstOrderHoldSystem discretize_foh(const Eigen::MatrixXd& A,
                                                  const Eigen::MatrixXd& B, double sample_time_s);

}  // namespace faultline

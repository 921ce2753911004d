#pragma once

#include <Eigen/Core>

namespace faultline {

/// Stabilising solution X of the discrete algebraic Riccati equation
///
///   X = Aᵀ X A - Aᵀ X B (R + Bᵀ X B)⁻¹ Bᵀ X A + Q
///
/// A n×n, B n×m, Q n×n symmetric >= 0, R m×m symmetric > 0; (A, B) stabilisable.
/// Structure-preserving doubling: Chu, Fan, Lin, Wang, Int. J. Control 77 (2004) 767-788.
/// @throws std::invalid_argument shapes, R not positive definite, or no stabilising solution.
[[nodiscard]] Eigen::MatrixXd solve_dare(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                         const Eigen::MatrixXd& Q, const Eigen::MatrixXd& R);

/// LQR gain K (m×n) of u = -K x for x_k+1 = A x + B u, cost Σ xᵀQx + uᵀRu:
/// K = (R + Bᵀ X B)⁻¹ Bᵀ X A.
[[nodiscard]] Eigen::MatrixXd lqr_gain(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                       const Eigen::MatrixXd& Q, const Eigen::MatrixXd& R);

/// Stabilising solution X of the continuous algebraic Riccati equation
///
///   0 = Aᵀ X + X A - X B R⁻¹ Bᵀ X + Q
///
/// A n×n, B n×m, Q n×n symmetric >= 0, R m×m symmetric > 0; (A, B) stabilisable, no unstable mode
/// on the imaginary axis hidden from Q. The same doubling after a Cayley transform: Chu, Fan, Lin,
/// Linear Algebra Appl. 396 (2005) 55-80.
/// @throws std::invalid_argument shapes, R not positive definite, or no stabilising solution.
[[nodiscard]] Eigen::MatrixXd solve_care(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                         const Eigen::MatrixXd& Q, const Eigen::MatrixXd& R);

}  // namespace faultline

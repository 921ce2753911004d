#pragma once

#include <complex>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace faultline {

/// D_1 such that F = A_0 + D_1 M has the spectrum asked for.
struct PolePlacement {
  bool is_possible = false;
  std::string reason;      ///< why not; empty if possible
  Eigen::MatrixXd D_1;     ///< d×rows
  double condition = 0.0;  ///< of F's eigenvectors (Frobenius): how sensitive the spectrum is
};

/// The real block-diagonal matrix with the spectrum `poles` (conjugates side by side): blocks λ and
/// [σ ω; -ω σ].
[[nodiscard]] Eigen::MatrixXd real_block_diagonal(const std::vector<std::complex<double>>& poles);

/// Places the poles of F = A_0 + D_1 M with F diagonalisable (over the complex numbers) and its
/// eigenvectors as well conditioned as a few sweeps can make them: Kautsky, Nichols, Van Dooren,
/// Int. J. Control 41 (1985) 1129-1155, method 0, on (A_0ᵀ, Mᵀ); complex pairs are swept as complex
/// vectors with their conjugates. Deterministic.
///
/// A_0 d×d, M rows×d with (M, A_0) observable; `poles`: d of them, closed under conjugation (the
/// conjugate directly after its partner). No pole can be had more often than rank M; further limits
/// for repeated poles follow from the observability indices and are found by trying.
[[nodiscard]] PolePlacement place_poles(const Eigen::MatrixXd& A_0, const Eigen::MatrixXd& M,
                                        const std::vector<std::complex<double>>& poles);

/// Makes F = A_0 + D_1 M decay at least as fast as asked: every pole lies left of -decay (s plane,
/// is_sampled false) or within the circle of radius `decay` (z plane). The shifted dual Riccati
/// equation weighs speed against the size of D_1:
///
///   D_1 = -Y Mᵀ,  0 = (A_0 + decay I) Y + Y (A_0 + decay I)ᵀ - Y Mᵀ M Y + μ² I,  μ = decay / ‖M‖
///
/// (s plane; in the z plane the same for A_0 / decay). B. D. O. Anderson, J. B. Moore, Linear
/// Optimal Control, 1971, section 4.2. (M, A_0) observable.
[[nodiscard]] PolePlacement place_decay(const Eigen::MatrixXd& A_0, const Eigen::MatrixXd& M,
                                        double decay, bool is_sampled);

}  // namespace faultline

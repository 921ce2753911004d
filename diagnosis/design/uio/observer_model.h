#pragma once

#include <Eigen/Core>

namespace faultline {

/// The sampled plant as the observer design sees it. States: the plant's own, behind them the sizes
/// of the faults that the observer estimates (random walks). Lipschitz terms have the middle of
/// their slopes in A; what is left has slopes δ, |δ_i| <= slope_radius_i:
///
///   x_k+1 = A x_k + E_o ψ(E_i x_k) + F_x m_k + M w_k    ψ: slopes within ±slope_radius
///   y_k   = C x_k + F_y m_k + W w_k                     |w_i| <= w_bound_i
///
/// (inputs left out: they do not reach the error.) w: disturbances, noises, drifts of the fault
/// states. m: the faults to be detected.
/// | symbol | shape |
/// |---|---|
/// | A | n×n |
/// | C | q×n |
/// | M, W | n×s, q×s |
/// | F_x, F_y | n×f, q×f |
/// | E_o, E_i | n×l, l×n |
struct ObserverModel {
  Eigen::MatrixXd A, C;
  Eigen::MatrixXd M, W;
  Eigen::VectorXd w_bound;  ///< s, > 0
  Eigen::MatrixXd F_x, F_y;
  Eigen::MatrixXd E_o, E_i;
  Eigen::VectorXd slope_radius;  ///< l, >= 0; the gain of the term is in it
  Eigen::VectorXd x_bound;       ///< n: |x_i| at the start at most

  [[nodiscard]] Eigen::Index n() const { return A.rows(); }
  [[nodiscard]] Eigen::Index vertex_count() const { return Eigen::Index{1} << slope_radius.size(); }
  /// Λ of a vertex: E_o diag(δ) E_i, δ_i = +slope_radius_i if bit i of `vertex` is set, else -.
  [[nodiscard]] Eigen::MatrixXd vertex(Eigen::Index vertex) const;
};

/// T, and S = I - T C, of an observer x̂ = z + T y: S D_1 = 0 for the directions D_1 that T
/// decouples.
struct DecouplingMatrices {
  Eigen::MatrixXd T;    ///< n×q
  Eigen::MatrixXd S;    ///< n×n
  Eigen::MatrixXd D_1;  ///< n×d: directions decoupled; no column: T = 0
};

/// What the residual of an observer is made of: r = R e + Q w + J m.
struct ObserverOutput {
  Eigen::MatrixXd R;  ///< rows×n
  Eigen::MatrixXd Q;  ///< rows×s
  Eigen::MatrixXd J;  ///< rows×f
};

/// y - ŷ: R = C, Q = W, J = F_y.
[[nodiscard]] ObserverOutput output_error(const ObserverModel& model);

/// A and B of e_k+1 = A_e e_k + B_now w_k + B_next w_k+1 + F_e m_k for Λ = 0 and a gain Γ (n×q).
struct ErrorDynamics {
  Eigen::MatrixXd N;       ///< S A - Γ C
  Eigen::MatrixXd B_now;   ///< S M - Γ W
  Eigen::MatrixXd B_next;  ///< -T W
  Eigen::MatrixXd F_e;     ///< S F_x - Γ F_y  (T F_y = 0 is expected)
};
[[nodiscard]] ErrorDynamics error_dynamics(const ObserverModel& model,
                                           const DecouplingMatrices& decoupling,
                                           const Eigen::MatrixXd& gain);

}  // namespace faultline

#pragma once

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// The error e = x - x̂ of the observer behind a filter, from the plant file and T, Γ alone
/// (ObserverCertificate has the equations):
///
///   e_k+1 = (N + S Λ_k) e_k + B_now w_k + B_next w_k+1 + F_now m_k + F_next m_k+1
///   r_k   = R e_k + Q w_k + J m_k,     Λ = E_o diag(δ) E_i,  |δ_i| <= radius_i
///
/// x: the plant's states, behind them the sizes of the faults carried as states. m: all faults of
/// the plant as inputs; of a carried one, too: then its state stays 0 in e, and e + (its state) m
/// is the error. w: disturbances, noises, drifts of the carried faults. | symbol | shape |
/// |---|---|
/// | N, S | n×n |
/// | T, gain (Γ) | n×q |
/// | B_now = S M - Γ W, B_next = -T W | n×s |
/// | F_now = S F_x - Γ F_y, F_next = -T F_y | n×k |
/// | R, Q, J | rows×n, rows×s, rows×k |
/// | S_E = S E_o, E_i | n×l, l×n |
///
/// Columns of B_now, B_next, Q that are zero but for rounding are exactly zero.
struct ObserverLoop {
  Eigen::MatrixXd A, B, C, D;  ///< plant in the bank's domain, with the carried faults
  Eigen::MatrixXd T, S, gain, N;
  Eigen::MatrixXd B_now, B_next, F_now, F_next;
  Eigen::MatrixXd R, Q, J;
  Eigen::MatrixXd S_E, E_i;
  Eigen::VectorXd radius;   ///< l; the gain of the term is in it
  Eigen::VectorXd w_bound;  ///< s: of healthy plants: drifts are 0, where there is no fault there
                            ///< is none; of decoupled disturbances 0: they do not enter
  Eigen::VectorXd e_bound;  ///< n: |e_0| <= |S| x̄ + |T W| w̄ from v_0 = 0, no fault at the start
  /// Whether the residual is the estimate m̂ of a carried fault; then R e = m̂ - m.
  bool is_estimate = false;

  [[nodiscard]] Eigen::Index n() const { return N.rows(); }
  [[nodiscard]] Eigen::Index terms() const { return radius.size(); }
  [[nodiscard]] Eigen::Index vertex_count() const { return Eigen::Index{1} << radius.size(); }
  /// N + S Λ at a vertex: bit i of its number: δ_i at its largest, else at its smallest.
  [[nodiscard]] Eigen::MatrixXd at_vertex(Eigen::Index vertex) const;
};

/// The observer that `filter` claims to be. `filter.observer` must be there.
/// @throws std::invalid_argument there is nothing to be proved: another method than "uio", a
///   continuous domain, T or Γ of the wrong shape, a fault that is not there or carried twice, an
///   estimate of a fault that is not carried; a disturbance that does not vanish from the error as
///   the bank says; a bound that the plant file does not give (disturbances, noises, range of the
///   states); more than 8 Lipschitz terms.
[[nodiscard]] ObserverLoop observer_loop(const PlantModel& plant, const Bank& bank,
                                         const ResidualFilter& filter);

/// The implementation form that belongs to an observer: what F, E, G, M, H, K and the Lipschitz
/// terms of its filter must be. With ỹ = y - D u, x̂ = v + T ỹ:
///
///   v_k+1 = N v + (Γ + N T) ỹ + S B u + Σ S E_o gain (φ(s) - c s),   s = E_i x̂
///   r     = ỹ - C x̂, or m̂
struct ObserverForm {
  Eigen::MatrixXd F, E, G, M, H, K;
  std::vector<FilterNonlinearity> nonlinearities;
};
[[nodiscard]] ObserverForm observer_form(const PlantModel& plant, const ObserverLoop& loop);

}  // namespace faultline

#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/eigenstructure/eigenstructure_request.h"
#include "diagnosis/design/geometric.h"

namespace faultline {

/// A residual that unknown inputs reach whatever is done:
///
///   e' = (A_0 + D_1 M) e - (b_d + D_1 h_d) d - (b_j + D_1 h_j) m_j
///   r  = Θ (M e - h_d d - h_j m_j)
///
/// | symbol | shape |
/// |---|---|
/// | A_0, M | n×n, q×n: those of a quotient, or A and C of a plant |
/// | b_d, h_d | n×l, q×l: d of size one is the largest (its bound) |
/// | b_j, h_j | n×1, q×1: m_j of size one is a fault of size one |
/// | Θ | p×q |
struct CompromiseTask {
  Eigen::MatrixXd A_0, M;
  Directions unknown;  ///< b_d, h_d
  Directions wanted;   ///< faults that the residual is to see: at least one
  bool is_sampled = false;
};

/// ‖[h_d, M b_d]‖: what of d reaches the outputs within a sample, or in the first derivative; its
/// left singular vectors belong to `singular_values`, ascending, and are `U`'s columns. q×q.
struct UnknownInputSpread {
  Eigen::VectorXd singular_values;  ///< q; zeros behind l of them
  Eigen::MatrixXd U;
};
[[nodiscard]] UnknownInputSpread unknown_input_spread(const CompromiseTask& task);

/// Rows Θ that minimise ‖Ē - Ē*‖_F subject to Θ Ē* = 0, Ē = [h_d, M b_d]: left singular vectors of
/// the `rows` smallest singular values (Eckart, Young). Jin and Zhang, (14)-(15), with the singular
/// values in ascending order: the text removes the largest. The cost is the root of the sum of
/// their squares.
[[nodiscard]] Eigen::MatrixXd low_rank_rows(const CompromiseTask& task, Eigen::Index rows);

/// Rows Θ that minimise ‖H B‖_F over H = Θ M with orthonormal rows, B = b_d: criterion (13) of Jin
/// and Zhang, which they leave open. With Q = orth(Mᵀ) and U the left singular vectors of the
/// smallest singular values of Qᵀ B: H = Uᵀ Qᵀ, Θ = H M⁺. At most rank M rows.
/// @pre h_d = 0
[[nodiscard]] Eigen::MatrixXd static_rows(const CompromiseTask& task, Eigen::Index rows);

/// A compromise, and what it is worth.
struct Compromise {
  bool is_possible = false;
  std::string reason;     ///< why not
  Eigen::MatrixXd Theta;  ///< p×q
  /// Gain from d to r, to the smallest gain of a wanted fault (at DC; of those seen in transients
  /// only, their largest). Gain: max over frequency of the largest singular value; rms: of r under
  /// white d (intensity one, per second or sample).
  double ratio = 0.0;
};

/// Θ of `rows` rows for a given D_1 (n×q; A_0 + D_1 M stable) by a criterion of gains:
///
///   min γ²  s.t.  T_d(λ)ᴴ Π T_d(λ) <= γ² I for all frequencies,  T_j(λ_j)ᴴ Π T_j(λ_j) >= 1,
///   Π = Θᵀ Θ >= 0
///
/// (rms: tr(Π X) for γ², X the covariance of r with Θ = I). Π of full rank is the exact optimum: a
/// semidefinite program, solved on frequencies to which the worst ones are added until they tell
/// nothing new. Fewer rows: the directions of Π in which the faults show most, weighed again by the
/// same program; a row by itself is also tried in the direction best for each fault. Lou, Willsky,
/// Verghese, Automatica 22 (1986) 333-344, is the like for parity relations.
[[nodiscard]] std::vector<Compromise> compromises_by_gain(const CompromiseTask& task,
                                                          const Eigen::MatrixXd& D_1,
                                                          CompromiseCriterion criterion);

/// The ratio of a given Θ and D_1. Infinite if a wanted fault is not seen, or with kRms if white
/// unknown inputs reach r directly in continuous time.
[[nodiscard]] double compromise_ratio(const CompromiseTask& task, const Eigen::MatrixXd& D_1,
                                      const Eigen::MatrixXd& Theta, CompromiseCriterion criterion);

/// D_1 that trade d against output noise of intensity ρ² for a dozen ρ, from fast to slow, all with
/// poles that decay at least as `decay` says (place_decay()): the stationary Kalman filters of
/// (A_0, M) shifted by it. As ρ falls they tend to what keeps d smallest against anything else that
/// reaches r (S. X. Ding, Model-Based Fault Diagnosis Techniques, 2nd ed., 2013, chapter 7).
[[nodiscard]] std::vector<Eigen::MatrixXd> trade_off_gains(const CompromiseTask& task,
                                                           double decay);

}  // namespace faultline

#pragma once

#include <optional>

#include <Eigen/Core>

#include "diagnosis/design/uio/observer_model.h"

namespace faultline {

/// The limit of the componentwise threshold: sup |r_i| over all w within their bounds and all
/// Lipschitz terms within theirs, no fault, long after the start (small gain). With
/// R' = [R; E_i], Q' = [Q; 0] and one course for each entry of w
///
///   h_0 = Q' + R' B_next,   h_j = R' N^(j-1) B_now + R' N^j B_next
///   b = Σ_j |h_j| w̄,   g = Σ_j |R' N^(j-1) S E_o| diag(λ)
///   q = (I - g_q)⁻¹ b_q,   r̄ = b_r + g_r q      (rows of R: r, of E_i: q)
///
/// exact for λ = 0. The last `carried` entries of w, the drifts of carried faults, count as zero:
/// without a fault there is none.
/// @return nothing if ρ(g_q) >= 1 (the small gain theorem does not hold) or N is not stable.
[[nodiscard]] std::optional<Eigen::VectorXd> component_threshold(
    const ObserverModel& model, const DecouplingMatrices& decoupling, const ObserverOutput& output,
    const Eigen::MatrixXd& gain, Eigen::Index carried);

}  // namespace faultline

#pragma once

#include <cstdint>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/design_model.h"
#include "diagnosis/design/geometric.h"

namespace faultline {

/// A residual generator in the domain of the design, complete with its poles.
struct DesignedFilter {
  Eigen::MatrixXd P, F, E, G, M, H;  ///< GeometricQuotient, GeometricFilter
};

/// The filter on ỹ = y - D u in the form that runs, with r scaled by `factor`. Continuous domain: y
/// by first-order hold, u held,
///
///   w_k+1 = F_d w_k - E_0 ỹ_k - E_1 ỹ_k+1 + G_d u_k,
///
/// and with v = w + E_1 ỹ:
///
///   v_k+1 = F_d v_k - (E_0 + F_d E_1) ỹ_k + G_d u_k,  r_k = M v_k - (H + M E_1) ỹ_k.
///
/// Held faults reach it through L and J = H D_f. Sampled domain: L = P L_d + E D_f, exactly.
/// Continuous domain: L = ∫_0^T e^(F τ) dτ P L_state + E D_f, the continuous filter's own response,
/// exact at DC; at other frequencies but for the hold of y. Fills the matrices of `filter` only.
void implement(const DesignModel& model, const DesignedFilter& designed, double sample_time_s,
               double factor, ResidualFilter& filter);

/// First j from which ‖M F^i‖ ρ stays below 1 % of the threshold for all i >= j, ρ being the
/// largest state error that a bad sample or an unknown start leaves: the channels' ranges
/// themselves, or what E and G make of them (docs/decisions/0003). At most a million.
[[nodiscard]] std::uint32_t forget_samples(const PlantModel& plant, const ResidualFilter& filter);

}  // namespace faultline

#pragma once

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Makes the residual white, of unit covariance, under the plant's noise (its sigmas), by the gain
/// of the stationary Kalman filter: with e_k+1 = F e_k - E D_n n_k, r_k = M e_k - H D_n n_k
///
///   P = F P Fᵀ + E N Eᵀ - K_w S K_wᵀ,  S = M P Mᵀ + H N Hᵀ,  N = D_n D_nᵀ
///   K_w = (F P Mᵀ + E N Hᵀ) S⁻¹
///   F <- F - K_w M,  E <- E - K_w H,  G <- G - K_w K,  L <- L - K_w J
///   (M, H, K, J) <- S^(-1/2) (M, H, K, J)
///
/// The order stays; the poles become those of the Kalman filter. Output injection of r does not
/// change which faults it sees. Anderson, Moore, Optimal Filtering, 1979, 4.1 and 5.5.
/// @throws std::invalid_argument no noise with a sigma reaches every row, or the filter would be at
///   the border of stability: the residual is a derivative of the noise.
void whiten(const PlantModel& plant, ResidualFilter& filter);

}  // namespace faultline

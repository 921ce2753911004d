#pragma once

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/discretize.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// One sample of the plant, x_k+1 = A x_k + B w_k, w held over it:
///
///   discrete plants:  as they are
///   kEuler:           A = I + A_p T, B = B_p T
///   else:             exactly, [A B; 0 I] = exp([A_p B_p; 0 0] T)
///
/// Of a bank of observers (method "uio") A has the Lipschitz terms with the middle c of their
/// slopes in it: + Σ gain·c·E_o E_i, E_o sampled like a column of B_p (the term is held over the
/// sample). Other methods are linear: they leave the terms out.
///
/// `inputs`: columns of B_p. Everything in coordinates x = diag(scales) x̃, `scales` positive, n.
/// @throws std::invalid_argument the numbers are not finite, or the bank's sample time is not the
///   discrete plant's.
[[nodiscard]] SampledSystem plant_step(const PlantModel& plant, const Bank& bank,
                                       const Eigen::MatrixXd& inputs,
                                       const Eigen::VectorXd& scales);

}  // namespace faultline

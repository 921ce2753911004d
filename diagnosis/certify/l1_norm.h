#pragma once

#include <Eigen/Core>

namespace faultline {

/// x_k+1 = A x_k + B w_k, r_k = C x_k + D w_k, A stable.
struct StableSystem {
  Eigen::MatrixXd A, B, C, D;
};

/// The l1 norms of the impulse responses from each w to each r: the largest |r_i| that |w_j| <= 1
/// can cause, whatever its course; some course reaches it.
///
///   |D| + Σ_k |C A^k B|   (element by element)
///
/// Never below it, and above it by at most 1e-9 of the largest entry: what the sum leaves out is
/// bounded and added.
/// @throws std::invalid_argument not stable, or it takes more than ten million samples.
[[nodiscard]] Eigen::MatrixXd l1_norm(const StableSystem& system);

}  // namespace faultline

#pragma once

#include <vector>

#include <Eigen/Core>

#include "diagnosis/certify/l1_norm.h"

namespace faultline {

/// Autocovariances of r without a fault, with w white, of unit covariance: R(0) .. R(lags),
///
///   P = A P Aᵀ + B Bᵀ (Lyapunov, by doubling: Smith 1968)
///   R(0) = C P Cᵀ + D Dᵀ,   R(j) = E r_k+j r_kᵀ = C A^(j-1) (A P Cᵀ + B Dᵀ)
///
/// @throws std::invalid_argument A is not stable.
[[nodiscard]] std::vector<Eigen::MatrixXd> autocovariances(const StableSystem& system,
                                                           std::size_t lags);

/// How often a Gaussian, stationary r starts to exceed its levels for `dwell` samples in a row, per
/// sample: the probability that at k = 1 .. dwell some |r_i(k)| > level_i, and at k = 0 none.
///
///   Σ over rows i_k and signs s_k of  P(s_k r_i_k(k) > level_i_k for all k, |r_i_1(0)| <=
///   level_i_1)
///
/// exact for one row (the events exclude each other), an upper bound for several. Of a dwell with
/// more than kMostPatterns of them some samples are left out: an upper bound, too. The
/// probabilities are those of Genz, J. Comput. Graph. Stat. 1 (1992) 141-149, on a fixed lattice:
/// right to 1 % here.
/// @param R R(0) .. R(dwell) at least
/// @param level positive, rows
[[nodiscard]] double exceedance_rate(const std::vector<Eigen::MatrixXd>& R,
                                     const Eigen::VectorXd& level, std::size_t dwell);

/// The factor c for which levels of c standard deviations are exceeded `rate` times per sample, 0 <
/// rate < 1/4.
[[nodiscard]] double exceedance_factor(const std::vector<Eigen::MatrixXd>& R, std::size_t dwell,
                                       double rate);

}  // namespace faultline

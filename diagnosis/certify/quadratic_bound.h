#pragma once

#include <cstddef>

#include "diagnosis/bank/bank.h"
#include "diagnosis/certify/observer_loop.h"

namespace faultline {

/// The quadratic bound of an observer from its α, P, μ (ObserverCertificate has the inequalities).
///
/// An inequality X <= Y counts as true if the largest eigenvalue of L⁻¹ X L⁻ᵀ, Y = L Lᵀ, is at most
/// 1 + 1e-8: a semidefinite solver leaves rounding errors of that size, and J changes by less than
/// 1e-7 / (1 - α) of itself for it.
struct QuadraticBound {
  double dynamic_eigenvalue = 0.0;  ///< of the first inequality, largest over the vertices
  double output_eigenvalue = 0.0;   ///< of the second
  double alpha = 0.0;
  double start = 0.0;   ///< λ_max(P) ‖e_bound‖²
  double later = 0.0;   ///< Σ (μ_now + μ_next) w̄²
  double direct = 0.0;  ///< Σ μ_direct w̄²

  [[nodiscard]] bool is_proved() const;
  /// J(k) and its limit.
  [[nodiscard]] double at(std::size_t k) const;
  [[nodiscard]] double limit() const;
  /// First k from which α^k start <= part of limit()².
  [[nodiscard]] double start_over_after(double part) const;
};

/// @param weight Ω, rows×rows.
/// @throws std::invalid_argument shapes do not fit; α not in (0, 1); P not symmetric and positive
///   definite; μ negative; anything not finite.
[[nodiscard]] QuadraticBound quadratic_bound(const ObserverLoop& loop,
                                             const ObserverCertificate& claims,
                                             const Eigen::MatrixXd& weight);

}  // namespace faultline

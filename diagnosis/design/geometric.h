#pragma once

#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/balance.h"
#include "diagnosis/design/pole_placement.h"
#include "diagnosis/design/subspace.h"

namespace faultline {

/// W* and S* of (C, A) for L, as orthonormal bases.
struct UnobservabilitySubspaces {
  Eigen::MatrixXd W;  ///< smallest (C, A)-invariant subspace that contains Im L
  Eigen::MatrixXd S;  ///< smallest (C, A)-unobservability subspace that contains Im L
};

/// W*: Z_0 = Im L,  Z_i = Im L + A (Z_{i-1} ∩ Ker C)
/// S*: Z_0 = R^n,   Z_i = W* + (A⁻¹ Z_{i-1}) ∩ Ker C      (A⁻¹: pre-image)
///
/// each until its dimension stands. A n×n, C q×n, L n×l.
/// Hou, Cheng, Hu, Jin, Acta Automatica Sinica 41 (2015) 1113-1122, (16)-(17); after Basile, Marro
/// 1969 and Massoumnia 1986.
[[nodiscard]] UnobservabilitySubspaces unobservability_subspaces(const Eigen::MatrixXd& A,
                                                                 const Eigen::MatrixXd& C,
                                                                 const Eigen::MatrixXd& L,
                                                                 SubspaceArithmetic& arithmetic);

/// The part of the plant that a residual can still see when it ignores given directions, before its
/// poles are chosen:
///
///   Ker P = S*;  M P = H C;  A_0 P = P A + E_0 C
///
/// | symbol | shape |
/// |---|---|
/// | P | d×n, d = n - dim S* |
/// | H | rows×q: basis of (C S*)^⊥ within the outputs that anything reaches |
/// | M | rows×d |
/// | A_0, E_0 | d×d, d×q |
///
/// Ranks are decided, and rows of P and H are orthonormal, in balanced units (balance.h), which are
/// the plant's own unless these differ by more than a factor of 16. No residual exists if H has no
/// row.
struct GeometricQuotient {
  Eigen::Index dim_w = 0;
  Eigen::Index dim_s = 0;
  Eigen::MatrixXd projector_w, projector_s;  ///< n×n, orthogonal in the plant's own units
  Eigen::MatrixXd P, H, M, A_0, E_0;
  Balance units;
  RankMargin margin;
  /// Per visible direction, how far it is from what is ignored, in balanced units:
  /// ‖b_j - Π_S b_j‖ / ‖b_j‖; with an output part ‖[P L_j + E_0 D_j; H D_j]‖ / ‖[L_j; D_j]‖.
  std::vector<double> visible_margin;
};

/// The quotient for x' = A x + Σ L_j m_j, y = C x + Σ D_j m_j with the directions (L_j, D_j) of
/// `ignored` decoupled for every waveform m_j.
///
/// A direction that reaches the output is decoupled exactly through the state it gets in
/// x_e = (x, m_j), m_j' arbitrary: S* of the extended plant contains that state, hence P_e = [P 0],
/// P L_j + E D_j = 0 and H D_j = 0. For a mere output direction this is the output projection
/// N D = 0, C̃ = N C (Hou 2015, section 2.4, corrected); E and H come out for the raw y.
/// `visible`: directions of all faults. Outputs that only faults or disturbances reach give rows of
/// H, too.
[[nodiscard]] GeometricQuotient geometric_quotient(const Eigen::MatrixXd& A,
                                                   const Eigen::MatrixXd& C,
                                                   const Directions& ignored,
                                                   const Directions& visible,
                                                   double tolerance = kRankTolerance);

/// GeometricQuotient::visible_margin of `directions`, everything in balanced units.
[[nodiscard]] std::vector<double> visible_margins(const Eigen::MatrixXd& P,
                                                  const Eigen::MatrixXd& E_0,
                                                  const Eigen::MatrixXd& H,
                                                  const Directions& directions);

/// The tolerances around kRankTolerance, of 1e-12 .. 1e-6 by decades, for which dim W*, dim S* and
/// the rows of H are those of `quotient`.
struct DimensionStability {
  double tolerance_min = 0.0;
  double tolerance_max = 0.0;
};
[[nodiscard]] DimensionStability dimension_stability(const Eigen::MatrixXd& A,
                                                     const Eigen::MatrixXd& C,
                                                     const Directions& ignored,
                                                     const Directions& visible,
                                                     const GeometricQuotient& quotient);

/// F, E of a residual generator on the quotient; with G = P B:
///
///   w' = F w - E y + G u,  r = M w - H y,  F = A_0 + D_1 M,  E = E_0 + D_1 H
///   e = w - P x:  e' = F e - Σ (P L_j + E D_j) m_j,  r = M e - Σ H D_j m_j
struct GeometricFilter {
  Eigen::MatrixXd F, E;
};
/// @pre placement.is_possible
[[nodiscard]] GeometricFilter complete_filter(const GeometricQuotient& quotient,
                                              const PolePlacement& placement);

}  // namespace faultline

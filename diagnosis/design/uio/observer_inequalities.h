#pragma once

#include <complex>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/lmi/lmi_problem.h"
#include "diagnosis/design/uio/observer_synthesis.h"

namespace faultline {

/// Data of the error's inequalities, in units in which the solver's tolerances mean something: w in
/// those of its bounds, w = w_unit w' (entries; |w'_j| <= w_size, one for all), faults m =
/// m'/fault_size, so that each moves the residual by about one. Then τ = w_size² Σ μ'. Entries of w
/// that do not enter at a place have no column there.
struct ErrorData {
  ErrorData(const ObserverModel& observer_model, const DecouplingMatrices& matrices,
            const ObserverOutput& observer_output);

  const ObserverModel& model;
  const DecouplingMatrices& decoupling;
  const ObserverOutput& output;
  std::vector<Eigen::Index> now, next, direct;  ///< entries of w that enter B_now, B_next, Q
  Eigen::MatrixXd SM_now, W_now;                ///< S M, W of `now`
  Eigen::MatrixXd TW_next;                      ///< T W of `next`
  Eigen::MatrixXd Q_direct;
  double w_size = 1.0;
  Eigen::VectorXd w_unit;
  double fault_size = 1.0;
  Eigen::MatrixXd SF_x, F_y, J;
  std::vector<Eigen::MatrixXd> vertices;  ///< S Λ, each different one once
};

/// Multipliers μ: columns, one entry per entry of w that enters.
struct BoundVariables {
  AffineMatrix P, mu_now, mu_next, mu_direct;
};
[[nodiscard]] BoundVariables add_bound_variables(LmiProblem& problem, const ErrorData& data);

/// Σ μ'.
[[nodiscard]] AffineMatrix sum_of_multipliers(const BoundVariables& bound);

/// (R): [R Q]ᵀ X [R Q] < diag(P, μ_direct).
void require_output_bound(LmiProblem& problem, const ErrorData& data, const BoundVariables& bound,
                          const AffineMatrix& X);

/// (L) at every vertex, with G N = G S A - Y C and G Γ = Y:
///
///   [-α P   0                      (G N + G S Λ)ᵀ ]
///   [  *   -(1-α) diag(μ)          (G B)ᵀ         ]  < 0,   B = [S M - Γ W, -T W]
///   [  *    *                      P - G - Gᵀ     ]
///
/// G + Gᵀ > P > 0 makes G regular; Gᵀ P⁻¹ G >= G + Gᵀ - P makes it the bound of analysis.
void require_error_bound(LmiProblem& problem, const ErrorData& data, const BoundVariables& bound,
                         const AffineMatrix& G, const AffineMatrix& Y, double alpha);

/// The same of a known gain, without G: [A_e B]ᵀ P [A_e B] < diag(α P, (1-α) μ) at every vertex.
void require_error_bound(LmiProblem& problem, const ErrorData& data, const BoundVariables& bound,
                         const Eigen::MatrixXd& gain, double alpha);

/// Ψ of a band in the generalised KYP lemma: the form σ(e⁺, e) = [e⁺; e]ᴴ (..) [e⁺; e] it adds is
/// 2 Re(s_1 e⁺ᴴ Q e) + s_2 eᴴ Q e. [Iwasaki, Hara, IEEE TAC 50 (2005) 41-59, table 1]
struct BandForm {
  std::complex<double> s_1;
  double s_2 = 0.0;
  [[nodiscard]] bool is_full() const { return s_1 == 0.0; }
  [[nodiscard]] bool is_complex() const { return s_1.imag() != 0.0; }
};
/// Low (1, -2 cos h), middle (e^{jc}, -2 cos w), high (-1, 2 cos l), full (0, 0).
/// @throws std::invalid_argument unless 0 <= low <= high <= π
[[nodiscard]] BandForm band_form(const FrequencyBand& band);

/// (H) at every vertex with β² = 1 (G F_e = G S F_x - Y F_y): ‖r‖² >= ‖m‖² over the band for
/// residuals weighted by X, by the multiplier of the reference system.
void require_h_minus(LmiProblem& problem, const ErrorData& data, const AffineMatrix& X,
                     const AffineMatrix& G, const AffineMatrix& Y, const FrequencyBand& band,
                     const ReferenceSystem& reference);

}  // namespace faultline

#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/uio/observer_model.h"

namespace faultline {

/// Frequencies over which a fault must be seen, rad per sample: 0 <= low <= high <= π. [0, h]: low;
/// [l, π]: high; [0, π]: full; else middle.
struct FrequencyBand {
  double low_rad = 0.0;
  double high_rad = 0.1;
};

/// The multiplier of the H- inequality: a reference system e' = a_0 e - V m.
struct ReferenceSystem {
  double a_0 = -0.05;
  Eigen::MatrixXd V;  ///< n×f
};

enum class ResidualWeight { kScalar, kFull };

/// Why there is no observer, or that there is.
enum class SynthesisStatus {
  kSolved,
  kInfeasible,  ///< no gain satisfies the inequalities (for these multipliers)
  kUnbounded,   ///< the threshold can be made as small as one likes: a bound is missing
  kInaccurate,  ///< the solver could not decide, or its answer did not pass the eigenvalue check
};

/// A gain and what proves its bounds.
struct ObserverSynthesis {
  SynthesisStatus status = SynthesisStatus::kInaccurate;
  std::string reason;    ///< if not solved: in words
  Eigen::MatrixXd gain;  ///< Γ, n×q
  double alpha = 0.0;
  Eigen::MatrixXd P;       ///< n×n, in the units of the weighted residual
  Eigen::MatrixXd weight;  ///< Ω, rows×rows; scaled so that β of Ω r is `beta`
  Eigen::VectorXd mu_now, mu_next, mu_direct;  ///< s each
  double tau = 0.0;        ///< Σ (mu_now + mu_next + mu_direct) w_bound²: J_th² in the end
  double beta = 0.0;       ///< certified; 0 for L∞ only
  double objective = 0.0;  ///< J_th/β of the SDP; L∞ only: J_th
};

/// H-/L∞: minimises J_th/β over Γ.
/// @param band absent: L∞ only, Ω = I.
[[nodiscard]] ObserverSynthesis synthesise_observer(const ObserverModel& model,
                                                    const DecouplingMatrices& decoupling,
                                                    const ObserverOutput& output, double alpha,
                                                    const std::optional<FrequencyBand>& band,
                                                    const ReferenceSystem& reference,
                                                    ResidualWeight weight);

/// The best quadratic bound of a given gain: P, μ that minimise τ at `alpha` for the weight Ω.
[[nodiscard]] ObserverSynthesis analyse_observer(const ObserverModel& model,
                                                 const DecouplingMatrices& decoupling,
                                                 const ObserverOutput& output,
                                                 const Eigen::MatrixXd& gain, double alpha,
                                                 const Eigen::MatrixXd& weight);

/// Smallest singular value of the transfer from m to Ω r at any frequency of the band, exactly
/// (generalised KYP), for Λ constant at each vertex. Empty entry: the solver could not tell.
[[nodiscard]] std::vector<std::optional<double>> h_minus_indices(
    const ObserverModel& model, const DecouplingMatrices& decoupling, const ObserverOutput& output,
    const Eigen::MatrixXd& gain, const Eigen::MatrixXd& weight, const FrequencyBand& band);

/// The same on a grid of `points` frequencies, per vertex: never below the exact one.
[[nodiscard]] std::vector<double> h_minus_on_grid(const ObserverModel& model,
                                                  const DecouplingMatrices& decoupling,
                                                  const ObserverOutput& output,
                                                  const Eigen::MatrixXd& gain,
                                                  const Eigen::MatrixXd& weight,
                                                  const FrequencyBand& band, int points);

}  // namespace faultline

#pragma once

#include <vector>

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/certify/l1_norm.h"
#include "diagnosis/certify/residual_evaluation.h"
#include "diagnosis/certify/sampled_plant.h"

namespace faultline {

/// One filter behind the sampled plant. With V_1 as in SampledPlant and e = v - V_1 ξ_1:
///
///   e_k+1 = F e_k - E y_2 + G u - V_1 s_1
///   r_k   = M e_k + N_1 ξ_1 - H y_2 + K u,   N_1 = M V_1 - H C_1
///
/// F is reduced to triangular form once: a frequency costs O(rows·d·(d + q + m)).
class FilterLoop {
 public:
  /// The filter must be stable. `plant` must outlive the loop.
  FilterLoop(SampledPlant& plant, const ResidualFilter& filter);

  [[nodiscard]] double spectral_radius() const { return radius_; }

  /// What reaches the residual at one frequency, per unit of each input of the plant.
  struct Gains {
    Eigen::VectorXd gain;         ///< ‖T‖₂
    Eigen::VectorXd possible;     ///< what the paths could add up to if nothing cancelled
    Eigen::VectorXd stored_gain;  ///< per fault: ‖M (zI - F)⁻¹ L + J‖₂ of the stored L, J
    Eigen::VectorXd internal_error;   ///< per fault: ‖T + M (zI - F)⁻¹ L + J‖₂
    Eigen::MatrixXcd fault_response;  ///< rows×k: T of the faults
  };
  [[nodiscard]] Gains at(double angle) const;

  /// How far, per fault, the stored L and J are from what must be exact, and its rounding error:
  /// ‖J - H D_f‖₂ in either domain; in the sampled one the second sample of the response to an
  /// impulse, ‖M L - H C L_d - M E D_f‖₂, in the continuous one the gain at DC.
  struct ExactResponse {
    Eigen::VectorXd error, noise;
  };
  [[nodiscard]] ExactResponse exact_response(DesignDomain domain) const;

  /// Angles of the filter's own resonances and of its band, beyond those of the plant.
  [[nodiscard]] std::vector<double> own_angles() const;
  /// -ln ρ(F), at most π: the rate of the slowest pole, per sample.
  [[nodiscard]] double band() const;

  /// How the filter's residual is evaluated.
  [[nodiscard]] const ResidualEvaluation& evaluation() const { return evaluation_; }

  /// The evaluation of r per unit of each fault, sample by sample from the onset of its step. The
  /// slow modes ξ_1
  /// that the filter cancels only nearly are left out: no bench lets them grow.
  class FaultStep {
   public:
    FaultStep(const SampledPlant& plant, const FilterLoop& loop);
    /// Of the current sample, one per fault; then goes on to the next.
    [[nodiscard]] const Eigen::VectorXd& advance();

   private:
    const FilterLoop& loop_;
    SampledPlant::FaultStep plant_;
    Eigen::MatrixXd e_, next_, r_;
    Eigen::VectorXd evaluations_;
  };

  /// Filter and plant as one stable system with the states (e, ξ_2): what reaches the residual but
  /// for N_1 ξ_1. Columns of B and D in this order:
  enum class Source {
    kPlant,   ///< inputs of the sampled plant: m inputs, k faults, l disturbances
    kOutput,  ///< errors of the samples of y: q
    kState,   ///< the plant's state moves by that much, in its own coordinates: n
  };
  [[nodiscard]] StableSystem stacked(Source source) const;
  /// N_1 ξ_1 per state of the plant, in its own coordinates: rows×n; zero where every slow mode is
  /// cancelled.
  [[nodiscard]] Eigen::MatrixXd uncancelled() const;

 private:
  void reduce();
  void solve_sylvester();

  SampledPlant& plant_;
  ResidualEvaluation evaluation_;
  Eigen::MatrixXd F_, E_, G_, M_, L_;  // balanced
  Eigen::MatrixXd H_, K_, J_;
  Eigen::MatrixXd V_1_;
  Eigen::MatrixXcd N_1_;  // in the coordinates of SampledPlant::Z
  Eigen::MatrixXcd T_, Q_;
  Eigen::MatrixXcd M_q_, inputs_q_;  // M Q; Qᴴ [E G V_1 L]
  double radius_ = 0.0;
};

/// Largest rounding error of a gain whose terms could add up to `possible`.
[[nodiscard]] double rounding_error(double possible);

}  // namespace faultline

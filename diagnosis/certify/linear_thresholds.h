#pragma once

#include <cstdint>

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/certify/filter_loop.h"
#include "diagnosis/certify/sampled_plant.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// What a linear filter's residual can be without a fault, in the sampled loop as it runs, from
/// plant, filter and the bank's ThresholdBasis alone.
struct LinearThresholds {
  ThresholdShares shares;
  /// Plain comparison: r̄(k), samples×rows, from the first sample on for every state within
  /// [states] range; the last row holds for all later samples. Empty where there is a test.
  Eigen::MatrixXd component;
  /// Sequential tests: what bounded sources add to each row, and h.
  Eigen::VectorXd offset;
  double threshold = 1.0;
};

/// Thresholds of `threshold = "certified"` for linear filters:
///
///   r̄_i = Σ_sources Σ_j |h_ij| w̄_j + c_i
///
/// h the impulse response from source j to row i (l1_norm(), each source at its worst, all at the
/// same time), w̄ its bound:
///
/// | source | enters | bound |
/// |---|---|---|
/// | disturbance that is not decoupled | its columns | the plant file's |
/// | noise | its column of y | the plant file's |
/// | resolution | y | half an LSB of each output; commands are read as they act, rounded |
/// | leakage: inputs | u | [inputs] range; what the hold of y leaves (continuous domain) |
/// | leakage: decoupled disturbances | their columns | the plant file's; likewise |
/// | leakage: disturbances taken as constant | a step | likewise |
/// | leakage: modes that the filter does not cancel | N_1 ξ_1 | [states] range |
/// | jitter | ∫_0^δ e^(A (T - s)) B ds, 0 <= δ <= jitter_s | a change by 2·[inputs] range |
/// | start | the state at sample 0 | [states] range |
///
/// Until the start has faded, r̄(k) has as much of each sum as there were samples. Without decoupled
/// modes that leak some course of the sources reaches r̄ (each source alone, hence all together).
///
/// c: with false_alarms_per_h > 0 noise that has a sigma counts as Gaussian: c is so many standard
/// deviations of the stationary residual (autocovariances()) that the filter's share of the rate,
/// one in the number of filters, is met: alarms take `dwell` samples in a row (exceedance_rate()).
/// What is bounded cannot make them more frequent.
///
/// Of a sequential test h is that at which its own share of the rate is met, rows and signs added
/// up (cusum_threshold(), glr_threshold()).
class LinearThresholdProof {
 public:
  /// `plant`, `bank`, `loop` must outlive it.
  LinearThresholdProof(const PlantModel& plant, const Bank& bank, SampledPlant& loop);

  /// @throws std::invalid_argument a bound or range is missing, nothing reaches the residual,
  /// start-up
  ///   takes longer than 20,000 samples, a residual under a sequential test is not white: with what
  ///   is to be done.
  [[nodiscard]] LinearThresholds prove(const ResidualFilter& filter) const;

 private:
  const PlantModel& plant_;
  const Bank& bank_;
  SampledPlant& loop_;
};

/// Writes what was proved into the filter: course or test, threshold, shares, forget_samples.
/// @throws std::invalid_argument as LinearThresholdProof.
void certify_linear_thresholds(const PlantModel& plant, const LinearThresholdProof& proof,
                               ResidualFilter& filter);

/// samples_to_forget() of a filter with certified thresholds: relative to them.
[[nodiscard]] std::uint32_t certified_forget_samples(const PlantModel& plant,
                                                     const ResidualFilter& filter,
                                                     double threshold_factor = 1.0);

}  // namespace faultline

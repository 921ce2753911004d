#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/certify/observer_loop.h"
#include "diagnosis/certify/observer_thresholds.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A number of samples until something falls below a bound: it may be met so closely that rounding
/// decides.
struct SampleCount {
  std::uint32_t value = 0;
  std::uint32_t smallest = 0, largest = 0;

  [[nodiscard]] bool allows(std::uint32_t count) const {
    return count >= smallest && count <= largest;
  }
};

/// What plant and observer say about a filter's claims.
struct ObserverProof {
  ObserverForm form;
  ObserverThresholds thresholds;
  std::vector<double> vertex_radius;
  std::vector<double> nominal_fault;  ///< per fault; half of the guaranteed one
  /// Smallest singular value of Ω·(transfer from `detects` to r) on 400 frequencies of the band, at
  /// every vertex: never below the least of all frequencies. Nothing if β is not claimed.
  std::optional<double> beta;
  double estimation_bound = 0.0;  ///< FaultEstimation::bound
  SampleCount settle, transient, forget;
};

/// FaultEstimation, transient_samples and forget_samples bound what a fault, or a bad sample, adds
/// to the residual of the healthy plant: the error is linear in both for any one course of the
/// slopes, so the bounds of ErrorBounds add up.
///
/// - settle: from then on a fault that has been constant since its onset, up to its size, adds at
///   most 5 % of the limit of r̄ to the error of its estimate; `bound` is 1.05 times that limit.
/// - transient: from then on a constant fault seen in transients only, up to 10 times its size,
/// adds
///   at most 5 % of the threshold: to fire later takes 95 % of the threshold from noise and
///   disturbances. 0 if that cannot be said: with the slopes off their middle the fault stays.
/// - forget: the sample itself, and those after it until what it left adds less than 1 % of the
///   threshold. It leaves |E| ȳ + |G| ū + Σ |W_i| radius_i (|a_y| ȳ + |a_u| ū) at most, ȳ, ū the
///   ranges of the channels.
///
/// @throws std::invalid_argument as observer_thresholds().
[[nodiscard]] ObserverProof prove_observer(const PlantModel& plant, const Bank& bank,
                                           const ResidualFilter& filter);

/// Whether β is at most the least gain on a grid of its band, to 1e-6 of it for rounding errors. A
/// check, not a proof: between the frequencies the gain may be less.
[[nodiscard]] bool is_beta_true(double claimed, double on_grid);

/// Writes what was proved into the filter: course, threshold, estimation, numbers of samples,
/// certificate.
/// @throws std::invalid_argument as prove_observer(); β is larger than what is true.
void certify_observer(const PlantModel& plant, const Bank& bank, ResidualFilter& filter);

}  // namespace faultline

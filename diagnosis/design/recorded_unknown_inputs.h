#pragma once

#include <optional>
#include <stdexcept>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Consecutive good samples of a run without a fault, in deviations from the operating point.
struct RecordedStretch {
  Eigen::MatrixXd y;  ///< q×samples
  Eigen::MatrixXd u;  ///< m×samples: u(k) acts from sample k to k + 1
};

/// What a record says of where unknown inputs enter.
struct RecordedUnknownInputs {
  std::size_t samples = 0;  ///< used
  /// Mean of eᵀ S⁻¹ e per output, e the innovation of the Kalman filter of the plant as its file
  /// says it, S its covariance: 1 if the file explains the record, more if something else acts.
  double innovation_before = 0.0;
  double innovation_after = 0.0;  ///< with the unknown inputs that were found
  /// Square roots of the eigenvalues of the unknown inputs' covariance in units of the state ranges
  /// (ones where the file has none) per second (per sample of a discrete plant), descending.
  Eigen::VectorXd singular_values;
  /// By how much each direction that was tried makes the record more likely (logarithm).
  std::vector<double> likelihood_gains;
  Eigen::Index rank = 0;       ///< those that count; 0: the plant's file explains the record
  Eigen::MatrixXd directions;  ///< n×rank: columns of the state equation, of length one
  Eigen::VectorXd largest;     ///< largest |d| of each in the record
  /// Angle between what the two halves of the record say by themselves, in degrees: the largest
  /// between the two subspaces. Beyond 20 or so it is not to be trusted.
  double halves_deg = 0.0;
};

/// The record does not tell: too short, or not what the plant can have sent.
class UnusableRecord : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Finds the directions E in which unknown inputs enter, x_k+1 = A_d x_k + B_d u_k + w_k, w = Γ E
/// d, Γ = ∫_0^T exp(A τ) dτ, from samples of y = C x + D u + v with the noise of the plant file:
/// those that make the spectrum of a Kalman filter's innovation most likely, whatever the spectrum
/// of d (innovation_spectrum.h), one after the other until one more is not worth it. The singular
/// value decomposition of the innovation by itself would mix into E what the filter makes of d, and
/// the noise.
///
/// @param rank how many directions; absent: as many as the record tells, none if the innovation of
///   the file's own filter is as small as the file says.
/// @throws UnusableRecord fewer than fifty samples per state, or a filter that cannot be had
[[nodiscard]] RecordedUnknownInputs find_unknown_inputs(const PlantModel& plant,
                                                        double sample_time_s,
                                                        const std::vector<RecordedStretch>& record,
                                                        std::optional<Eigen::Index> rank);

}  // namespace faultline

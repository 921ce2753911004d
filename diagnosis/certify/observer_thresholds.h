#pragma once

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// The thresholds of an observer's residual, from plant and observer alone: T, Γ, α, P, μ, Ω and
/// the faults carried as states. Entry k holds for sample k after a start with v = 0, whatever the
/// plant's state within its range; the last one for all later samples.
///
///   component: |r_i(k)| <= r̄_i(k) by l1 norms and small gain (error_bounds.h); at least 1e-6 of
///              the limit, so that no row is divided by zero
///   norm:      ‖Ω r(k)‖ <= J(k) by the quadratic bound (ObserverCertificate)
///
/// Both of a plant without a fault: carried faults stay 0, their drifts too.
struct ObserverThresholds {
  Eigen::MatrixXd component;        ///< samples×rows; last row: max(last computed, limit)
  Eigen::VectorXd component_limit;  ///< rows
  Eigen::VectorXd norm;             ///< samples; empty: the observer has no P
  double norm_limit = 0.0;
};

/// As long as it takes until what is left of the start is below 1e-12 of the limits.
/// @throws std::invalid_argument what the filter claims cannot be proved: as observer_loop(); the
///   error cannot be bounded (not stable, small gain); α, P, μ, Ω do not satisfy their inequalities
///   at every vertex; a threshold would be zero, as nothing bounded reaches the residual; start-up
///   takes longer than 20,000 samples. `filter.observer` must be there.
[[nodiscard]] ObserverThresholds observer_thresholds(const PlantModel& plant, const Bank& bank,
                                                     const ResidualFilter& filter);

}  // namespace faultline

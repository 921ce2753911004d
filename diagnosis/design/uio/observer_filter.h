#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/uio/observer_plant.h"
#include "diagnosis/design/uio/observer_synthesis.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// An observer that has been designed.
struct DesignedObserver {
  ObserverTask task;
  ObserverModel model;
  DecouplingMatrices decoupling;
  std::vector<std::size_t> decoupled;  ///< disturbances that do not reach its error
  ObserverSynthesis synthesis;
  FrequencyBand band;  ///< of β, if it has one
};

/// Its filter with the residual y - ŷ, in the implementation form: v = z of x̂ = z + T (y - D u),
///
///   F = N,  E = -(Γ + N T),  G = S B + E D,  M = -C,  H = -(I - C T),  K = H D
///   W = S E_o gain,  s = E_i v + E_i T (y - D u)
///
/// Thresholds and certificate are left to diagnosis/certify.
[[nodiscard]] ResidualFilter output_filter(const PlantModel& plant, const ObserverPlant& sampled,
                                           const DesignedObserver& observer, std::string name);

/// Its filter whose residual is the estimated size of the carried fault number `carried`:
/// M = row of the fault's state, H = -M T, K = H D.
[[nodiscard]] ResidualFilter size_filter(const PlantModel& plant, const ObserverPlant& sampled,
                                         const DesignedObserver& observer, std::size_t carried,
                                         std::string name);

/// Gains from constant faults (all of the plant's, one column each) to the residual of a filter at
/// rest, slopes at `vertex` of the model (-1: in the middle): M (I - F - ..)⁻¹ .. per unit.
[[nodiscard]] Eigen::MatrixXd rest_gains(const ResidualFilter& filter, const ObserverPlant& sampled,
                                         const DesignedObserver& observer, Eigen::Index vertex);

}  // namespace faultline

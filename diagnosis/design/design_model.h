#pragma once

#include <vector>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/geometric.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Set of faults, as sorted indices into PlantModel::faults.
using FaultSet = std::vector<std::size_t>;

/// The plant in the domain of the design. Disturbances taken as constant are states behind the
/// plant's own, with d' = 0 (d_k+1 = d_k):
///
///   A = [A E_d; 0 0],  C = [C D_f]
///
/// n stands for all states from here on.
struct DesignModel {
  Eigen::MatrixXd A, B, C, D;
  Directions faults;     ///< one per fault of the plant
  Directions decoupled;  ///< disturbances that no residual may see
  Directions weakened;   ///< those to be kept small, per bound (per unit if there is none)
  bool is_sampled = false;
};

/// @throws InputError a disturbance that the plant does not have, or that is asked for twice.
[[nodiscard]] DesignModel design_model(const PlantModel& plant, const BankRequest& request);

/// What a residual has to ignore: the faults of `ignores` and all decoupled disturbances.
[[nodiscard]] Directions ignored_directions(const DesignModel& model, const FaultSet& ignores);

}  // namespace faultline

#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/uio/observer_model.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A plant in the domain of the request, everything held over a sample, as observers are made for
/// it. Lipschitz terms are inputs here: x_k+1 = A x_k + B u_k + Σ E_o gain φ(E_i x_k) + ..
struct ObserverPlant {
  Eigen::MatrixXd A, B, C, D;
  Eigen::MatrixXd fault_states, fault_outputs;              ///< n×k, q×k: of all faults
  Eigen::MatrixXd disturbance_states, disturbance_outputs;  ///< n×d, q×d
  Eigen::MatrixXd noise_outputs;                            ///< q×v
  Eigen::MatrixXd E_o, E_i;                                 ///< n×l, l×n
};

/// @throws InputError more Lipschitz terms than an observer can have (their slopes' corners double
///   with each).
[[nodiscard]] ObserverPlant observer_plant(const PlantModel& plant, const BankRequest& request);

/// Indices of faults by name. `key`: of [uio], for the message.
/// @throws InputError there is no such fault, or it is named twice.
[[nodiscard]] std::vector<std::size_t> fault_indices(const PlantModel& plant,
                                                     const BankRequest& request,
                                                     const std::string& key,
                                                     const std::vector<std::string>& names);

/// What an observer is to do.
struct ObserverTask {
  std::vector<std::size_t> carry;   ///< faults carried as states
  std::vector<std::size_t> detect;  ///< faults behind F_x, F_y
  double drift_bound = 0.0;         ///< per sample, of every fault carried
};

/// The model that the inequalities are about. Disturbances whose direction D_1 of the decoupling
/// contains stay in M: S M is zero there.
/// @throws InputError a bound is missing: of a state, a noise, or a disturbance that is not in
///   `decoupled` (indices).
[[nodiscard]] ObserverModel observer_model(const PlantModel& plant, const BankRequest& request,
                                           const ObserverPlant& sampled, const ObserverTask& task,
                                           const std::vector<std::size_t>& decoupled);

}  // namespace faultline

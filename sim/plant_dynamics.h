#pragma once

#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/nonlinearity.h"
#include "diagnosis/model/plant_model.h"
#include "sim/integration.h"

namespace faultline {

/// The right-hand side of a plant's state equation, in deviations:
///
///   f(x) = A x + B u + L m + E d + Φ φ(E_i x)
///
/// the derivative of x, or its value one sample later.
/// | symbol | shape | |
/// |---|---|---|
/// | L | n×component faults | |
/// | E | n×disturbances | |
/// | Φ | n×l | gain·E_o of each nonlinearity |
/// | E_i | l×n | |
struct PlantDynamics {
  Eigen::MatrixXd A, B, L, E, Phi, E_i;
  std::vector<NonlinearFunction> functions;  ///< φ, l

  /// φ(E_i x) into `phi` (l). Real-time: neither allocates nor throws.
  void evaluate_nonlinearities(const Eigen::Ref<const Eigen::VectorXd>& x,
                               Eigen::VectorXd& phi) const noexcept;
};

/// The output equation before sensor faults, in deviations:
///
///   y = C x + D u + D_m m + D_f d + F w
///
/// C q×n, D q×m, and one column per component fault, disturbance and noise source.
struct PlantOutputs {
  Eigen::MatrixXd C, D, D_m, D_f, F;
};
[[nodiscard]] PlantOutputs own_outputs(const PlantModel& model);

/// The plant's own equation.
[[nodiscard]] PlantDynamics own_dynamics(const PlantModel& model);

/// A continuous plant's equation from one sample to the next, all but A x held over the sample:
/// kZoh (and kExact): A exact; kEuler: I + A T.
[[nodiscard]] PlantDynamics sampled_dynamics(const PlantDynamics& continuous,
                                             IntegrationMethod method, double sample_time_s);

}  // namespace faultline

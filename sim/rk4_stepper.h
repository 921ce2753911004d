#pragma once

#include <memory>

#include <Eigen/Core>

#include "sim/plant_dynamics.h"

namespace faultline {

/// Solves x' = A x + g + Φ φ(E_i x), g held, over one sample with the classical Runge-Kutta method
/// of order 4 (Boost.Odeint).
class Rk4Stepper {
 public:
  /// Sizes everything. @param substeps equal steps per sample, at least 1.
  Rk4Stepper(PlantDynamics dynamics, double sample_time_s, int substeps);
  Rk4Stepper(Rk4Stepper&&) noexcept;
  Rk4Stepper& operator=(Rk4Stepper&&) noexcept;
  ~Rk4Stepper();

  /// x_k+1 in place of x_k (n), for the drive g (n). Real-time: neither allocates nor throws.
  void step(const Eigen::VectorXd& g, Eigen::VectorXd& x) noexcept;

 private:
  // Odeint's headers stay out of everybody else's sight: they are slow to compile.
  struct Workspace;
  std::unique_ptr<Workspace> workspace_;
};

}  // namespace faultline

#pragma once

#include <optional>
#include <span>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"
#include "sim/fault_schedule.h"
#include "sim/integration.h"
#include "sim/perturbation.h"
#include "sim/plant_dynamics.h"
#include "sim/rk4_stepper.h"

namespace faultline {

/// A plant that is stepped from sample to sample. Commands u, faults, disturbances d and noise w
/// are held over each:
///
///   f(x)  = A x + B (Γ_u u + b_u) + L m + E_d d + Σ gain·E_o·φ(E_i x)
///   y_k   = Γ_y (C x_k + D (Γ_u u_k + b_u) + D_m m_k + D_f d_k + F w_k) + b_y
///
/// x_k+1 follows from f by the method of integration. Everything at its interface is absolute
/// (operating point included); inside are deviations.
class SimulatedPlant {
 public:
  /// @param sample_time_s for continuous plants; a discrete plant's own must be equal.
  /// @throws std::invalid_argument sample time not positive or not the discrete plant's; a method
  ///   of integration the plant cannot have.
  SimulatedPlant(const PlantModel& model, double sample_time_s,
                 const Integration& integration = {});

  /// Sets the absolute state; n values.
  void reset(const Eigen::VectorXd& x) noexcept;

  /// y_k into `y` (q values), for the command `u` (m values) and what acts now.
  void measure(std::span<const double> u, const ActiveFaults& faults,
               const ActivePerturbations& perturbations, std::span<double> y) noexcept;
  /// Goes from k to k+1.
  void step(std::span<const double> u, const ActiveFaults& faults,
            const ActivePerturbations& perturbations) noexcept;

  /// Absolute state x_k.
  [[nodiscard]] const Eigen::VectorXd& state() const noexcept { return x_absolute_; }
  /// False once a state has left the finite numbers.
  [[nodiscard]] bool is_finite() const noexcept { return dx_.allFinite(); }

 private:
  void actuate(std::span<const double> u, const ActiveFaults& faults) noexcept;

  PlantDynamics dynamics_;         // from sample to sample; of x' where rk4_ is
  std::optional<Rk4Stepper> rk4_;  // else one product per sample
  PlantOutputs outputs_;
  Eigen::VectorXd x_operating_, u_operating_, y_operating_;
  Eigen::VectorXd dx_, dx_next_, du_, dy_, phi_, x_absolute_;
};

}  // namespace faultline

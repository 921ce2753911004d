#pragma once

#include <span>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"
#include "sim/fault_schedule.h"

namespace faultline {

/// A linear plant stepped exactly: inputs and faults are held over each sample (zero-order hold).
///
///   x_k+1 = A_d x_k + B_d (Γ_u u_k + b_u) + L_d m_k
///   y_k   = Γ_y (C x_k + D (Γ_u u_k + b_u) + D_m m_k) + b_y
///
/// Everything at its interface is absolute (operating point included); inside are deviations.
class LinearPlant {
 public:
  /// @param sample_time_s for continuous plants; a discrete plant's own must be equal.
  /// @throws std::invalid_argument sample time not positive or not the discrete plant's; the model
  ///   has nonlinearities.
  LinearPlant(const PlantModel& model, double sample_time_s);

  /// Sets the absolute state; n values.
  void reset(const Eigen::VectorXd& x) noexcept;

  /// y_k into `y` (q values), for the command `u` (m values) and the faults acting now.
  void measure(std::span<const double> u, const ActiveFaults& faults, std::span<double> y) noexcept;
  /// Goes from k to k+1.
  void step(std::span<const double> u, const ActiveFaults& faults) noexcept;

  /// Absolute state x_k.
  [[nodiscard]] const Eigen::VectorXd& state() const noexcept { return x_absolute_; }
  /// False once a state has left the finite numbers.
  [[nodiscard]] bool is_finite() const noexcept { return dx_.allFinite(); }

 private:
  void actuate(std::span<const double> u, const ActiveFaults& faults) noexcept;

  Eigen::MatrixXd A_, B_, L_, C_, D_, D_m_;
  Eigen::VectorXd x_operating_, u_operating_, y_operating_;
  Eigen::VectorXd dx_, dx_next_, du_, dy_, x_absolute_;
};

}  // namespace faultline

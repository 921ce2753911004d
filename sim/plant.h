#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "sim/perturbation.h"

namespace faultline {

/// Something inside a plant that a fault may change: a fault of the plant file (nominally 0), or a
/// parameter of a plant in C++.
struct PlantComponent {
  std::string name;
  double nominal = 0.0;
};

/// What drives a plant over one sample, held meanwhile.
struct PlantDrive {
  std::span<const double> u;  ///< m: what the actuators do, absolute
  std::span<const double>
      component;  ///< one per PlantComponent, in order: its deviation from nominal
  const ActivePerturbations& perturbations;
};

/// A plant that is stepped from sample to sample. Everything at its interface is absolute
/// (operating point included). Actuator and sensor faults lie outside of it (plant_faults.h).
class SimulatedPlant {
 public:
  virtual ~SimulatedPlant() = default;

  /// Sets the absolute state; n values.
  virtual void reset(const Eigen::VectorXd& x) noexcept = 0;
  /// y_k into `y` (q values), before any sensor fault. Real-time.
  virtual void measure(const PlantDrive& drive, std::span<double> y) noexcept = 0;
  /// Goes from k to k+1. Real-time: neither allocates nor throws.
  virtual void step(const PlantDrive& drive) noexcept = 0;

  /// Absolute state x_k.
  [[nodiscard]] virtual const Eigen::VectorXd& state() const noexcept = 0;
  [[nodiscard]] virtual const std::vector<PlantComponent>& components() const noexcept = 0;
  /// False once a state has left the finite numbers, or the integrator could not go on.
  [[nodiscard]] virtual bool is_finite() const noexcept = 0;
  /// Why not, with the state's name: "link_speed is not finite"; empty while `is_finite`.
  [[nodiscard]] virtual std::string failure() const = 0;

 protected:
  SimulatedPlant() = default;
  SimulatedPlant(const SimulatedPlant&) = default;
  SimulatedPlant& operator=(const SimulatedPlant&) = default;
};

}  // namespace faultline

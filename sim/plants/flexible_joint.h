#pragma once

#include "sim/plant_equations.h"

namespace faultline {

/// The single-link robot with a flexible joint, motor and link coupled by a spring, gravity on the
/// link; the link's speed is scaled by 1/10. examples/ma2024/plant.toml is the same plant.
///
///   θ_m' = ω_m                    ω_m' = -48.6 (θ_m - θ_l) - 1.25 ω_m + 21.6 u
///   θ_l' = 10 ω_l                 ω_l' = 1.95 (θ_m - θ_l) - 0.333 sin θ_l
///   y = (θ_m, ω_m, θ_l + ω_l)
struct FlexibleJoint {
  static constexpr const char* name = "flexible_joint";
  static constexpr const char* description = "single-link robot with a flexible joint";
  static constexpr const char* source =
      "Ma, Gao, Guo, Control Theory & Applications 41(2), 2024, section 5";
  static constexpr PlantSignal states[] = {{"motor_angle", "rad", 0, 20},
                                           {"motor_speed", "rad/s", 0, 20},
                                           {"link_angle", "rad", 0, 20},
                                           {"link_speed", "rad/s / 10", 0, 5}};
  static constexpr PlantSignal inputs[] = {{"u1", "Nm", 0, 2}};
  static constexpr PlantSignal outputs[] = {
      {"y1", "rad", 0, 20}, {"y2", "rad/s", 0, 20}, {"y3", "rad", 0, 20}};
  static constexpr PlantSignal disturbances[] = {
      {"zd1", "", 0, 0.1}, {"zd2", "", 0, 0.1}, {"zd3", "", 0, 0.1}};

  static void derivative(const double* x, const double* u, const double* p, const double* d,
                         double* dx);
  static void measure(const double* x, const double* u, const double* p, const double* d,
                      double* y);
};

}  // namespace faultline

#pragma once

#include <array>
#include <cstddef>

#include "sim/plant_equations.h"

namespace faultline {

/// A surface vessel in the horizontal plane with four azimuth thrusters (Fossen's equations):
///
///   η' = R(ψ) ν,   M ν' + C(ν) ν + D(ν) ν = Σ τ_i + wind,   η = (x, y, ψ), ν = (u, v, r)
///   τ_i = (T cos α, T sin α, l_x T sin α - l_y T cos α)
///
/// x north, y east, heading ψ; surge u forward, sway v to starboard, yaw rate r; wind in the body's
/// frame. The thrusters work against each other at rest, so that their angles act, too.
///
/// D is diagonal: -X_u - X_uu |u|, -Y_v - Y_vv |v|, -N_r - N_rr |r|, all positive, so that
/// νᵀ D ν >= 0. With C skew-symmetric the energy νᵀ M ν / 2 of the unforced vessel never grows. The
/// cross terms that Skjetne et al. identified are left out: with Y_r = -7.25 and N_v = 0.03 the
/// symmetric part of D is indefinite at rest (d22 d33 = 1.7 < 13 = ((d23 + d32) / 2)²), and such a
/// vessel would gain speed from still water.
struct AzimuthVessel {
  static constexpr double kMass_kg = 23.8;
  static constexpr double kInertia_kg_m2 = 1.76;
  static constexpr double kCentre_m = 0.046;  ///< x_g
  static constexpr double kX_udot = -2.0, kY_vdot = -10.0, kN_rdot = -1.0;
  static constexpr double kX_u = -0.72253, kX_uu = -1.32742;
  static constexpr double kY_v = -0.88965, kY_vv = -36.47287;
  static constexpr double kN_r = -1.900, kN_rr = -0.75;
  static constexpr std::size_t kThrusters = 4;
  /// Where they are, ours: fore and aft, port and starboard (CyberShip II is 1.255 m by 0.29 m).
  static constexpr std::array<double, kThrusters> kThruster_x_m{0.45, 0.45, -0.45, -0.45};
  static constexpr std::array<double, kThrusters> kThruster_y_m{-0.12, 0.12, -0.12, 0.12};
  static constexpr double kPi = 3.141592653589793;

  static constexpr const char* name = "azimuth_vessel";
  static constexpr const char* description =
      "surface vessel, 3 degrees of freedom, four azimuth thrusters biased against each other";
  static constexpr const char* source =
      "CyberShip II: Skjetne, Smogeli, Fossen, Modeling, Identification and Control 25 (2004), "
      "diagonal damping; thrusters ours";
  static constexpr PlantSignal states[] = {{"x", "m", 0, 1},       {"y", "m", 0, 1},
                                           {"psi", "rad", 0, 0.3}, {"u", "m/s", 0, 0.2},
                                           {"v", "m/s", 0, 0.2},   {"r", "rad/s", 0, 0.2}};
  static constexpr PlantSignal inputs[] = {{"thrust1", "N", 1, 0.5},
                                           {"thrust2", "N", 1, 0.5},
                                           {"thrust3", "N", 1, 0.5},
                                           {"thrust4", "N", 1, 0.5},
                                           {"angle1", "rad", kPi / 3, 0.4},
                                           {"angle2", "rad", -kPi / 3, 0.4},
                                           {"angle3", "rad", 2 * kPi / 3, 0.4},
                                           {"angle4", "rad", -2 * kPi / 3, 0.4}};
  static constexpr PlantSignal outputs[] = {
      {"north", "m", 0, 1},     {"east", "m", 0, 1},     {"heading", "rad", 0, 0.3},
      {"surge", "m/s", 0, 0.2}, {"sway", "m/s", 0, 0.2}, {"yaw_rate", "rad/s", 0, 0.2}};
  static constexpr PlantSignal disturbances[] = {
      {"wind_surge", "N", 0, 0.02},         {"wind_sway", "N", 0, 0.02},
      {"wind_yaw", "N m", 0, 0.004},        {"noise_north", "m", 0, 0.002},
      {"noise_east", "m", 0, 0.002},        {"noise_heading", "rad", 0, 0.001},
      {"noise_surge", "m/s", 0, 0.002},     {"noise_sway", "m/s", 0, 0.002},
      {"noise_yaw_rate", "rad/s", 0, 0.002}};

  using Vector3 = std::array<double, 3>;
  /// C(ν) ν.
  [[nodiscard]] static Vector3 coriolis(const Vector3& nu) noexcept;
  /// D(ν) ν.
  [[nodiscard]] static Vector3 damping(const Vector3& nu) noexcept;
  /// νᵀ M ν / 2, in J.
  [[nodiscard]] static double energy_J(const Vector3& nu) noexcept;

  static void derivative(const double* x, const double* u, const double* p, const double* d,
                         double* dx);
  static void measure(const double* x, const double* u, const double* p, const double* d,
                      double* y);
};

}  // namespace faultline

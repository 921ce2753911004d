#pragma once

#include <array>
#include <cstddef>

#include "sim/plant_equations.h"

namespace faultline {

/// An electric car with a motor in each wheel, in the plane: front left, front right, rear left,
/// rear right. Body axes x forward, y to the left, yaw rate r to the left.
///
///   m (v_x' - r v_y) = Σ F_x - c_d v_x² - c_r m g - m g slope
///   m (v_y' + r v_x) = Σ F_y + side_wind
///   I_z r'           = Σ (x_i F_y - y_i F_x) + x_w side_wind
///   J ω_i'           = T_i - brake_i - R F_i
///
/// Tyres: with the slips κ = (R ω - v_l) / |v_l|, tan α = v_t / |v_l| of a wheel's centre, l along
/// the wheel and t across it, the demand is s = (C_κ κ, -C_α tan α), and the force what friction
/// leaves of it, tanh(|s| / μ F_z) μ F_z s / |s|: it saturates on the circle of friction.
struct ElectricCar {
  static constexpr double kMass_kg = 1573.0;
  static constexpr double kYawInertia_kg_m2 = 2873.0;
  static constexpr double kFront_m = 1.10;  ///< l_f, from the centre of gravity to the front axle
  static constexpr double kRear_m = 1.58;   ///< l_r
  static constexpr double kTrack_m = 1.50;
  static constexpr double kCornering_N = 80000.0;      ///< C_α of one tyre, N/rad
  static constexpr double kLongitudinal_N = 100000.0;  ///< C_κ of one tyre, N per unit of slip
  static constexpr double kFriction = 0.9;             ///< μ, dry road
  static constexpr double kWheelRadius_m = 0.30;
  static constexpr double kWheelInertia_kg_m2 = 1.5;  ///< wheel and rotor
  static constexpr double kAirDrag_N_s2_m2 = 0.42;    ///< ρ c_w A / 2: 1.2 · 0.32 · 2.2 / 2
  static constexpr double kRolling = 0.015;           ///< c_r
  static constexpr double kGravity_m_s2 = 9.81;
  static constexpr double kWindArm_m = 0.4;  ///< the wind's centre before the centre of gravity
  /// Slips are taken of no less than this speed, brakes and rolling resistance fade below it.
  static constexpr double kLeastSpeed_m_s = 0.5;
  static constexpr std::size_t kWheels = 4;

  static constexpr double kSpeed_m_s = 20.0;
  /// What a motor gives at 20 m/s: a quarter of the resistance, times R.
  static constexpr double kTorque_Nm =
      (kAirDrag_N_s2_m2 * kSpeed_m_s * kSpeed_m_s + kRolling * kMass_kg * kGravity_m_s2) / 4.0 *
      kWheelRadius_m;
  static constexpr double kWheelSpeed_rad_s = kSpeed_m_s / kWheelRadius_m;

  static constexpr const char* name = "electric_car";
  static constexpr const char* description =
      "electric car with four wheel motors and steering, lateral and longitudinal, 20 m/s";
  static constexpr const char* source =
      "mass, geometry, cornering stiffness: Rajamani, Vehicle Dynamics and Control, 2nd ed.; "
      "tanh tyre, wheels, resistance: usual values";
  static constexpr PlantSignal states[] = {{"v_x", "m/s", kSpeed_m_s, 3},
                                           {"v_y", "m/s", 0, 1},
                                           {"r", "rad/s", 0, 0.3},
                                           {"w1", "rad/s", kWheelSpeed_rad_s, 10},
                                           {"w2", "rad/s", kWheelSpeed_rad_s, 10},
                                           {"w3", "rad/s", kWheelSpeed_rad_s, 10},
                                           {"w4", "rad/s", kWheelSpeed_rad_s, 10}};
  static constexpr PlantSignal inputs[] = {{"motor1", "N m", kTorque_Nm, 100},
                                           {"motor2", "N m", kTorque_Nm, 100},
                                           {"motor3", "N m", kTorque_Nm, 100},
                                           {"motor4", "N m", kTorque_Nm, 100},
                                           {"steering", "rad", 0, 0.05}};
  static constexpr PlantSignal outputs[] = {
      {"speed", "m/s", 0, 3},     {"side_speed", "m/s", 0, 1}, {"yaw_rate", "rad/s", 0, 0.3},
      {"wheel1", "rad/s", 0, 10}, {"wheel2", "rad/s", 0, 10},  {"wheel3", "rad/s", 0, 10},
      {"wheel4", "rad/s", 0, 10}};
  static constexpr PlantSignal parameters[] = {{"brake1", "N m", 0, 20},
                                               {"brake2", "N m", 0, 20},
                                               {"brake3", "N m", 0, 20},
                                               {"brake4", "N m", 0, 20},
                                               {"friction", "", kFriction, 0}};
  static constexpr PlantSignal disturbances[] = {{"slope", "", 0, 0.02},
                                                 {"side_wind", "N", 0, 500},
                                                 {"noise_speed", "m/s", 0, 0.004},
                                                 {"noise_side_speed", "m/s", 0, 0.004},
                                                 {"noise_yaw_rate", "rad/s", 0, 0.0008},
                                                 {"noise_wheel1", "rad/s", 0, 0.008},
                                                 {"noise_wheel2", "rad/s", 0, 0.008},
                                                 {"noise_wheel3", "rad/s", 0, 0.008},
                                                 {"noise_wheel4", "rad/s", 0, 0.008}};

  struct TyreForce {
    double along_N, across_N;
  };
  /// Of a wheel that turns with `wheel_speed_rad_s`, whose centre moves with (along, across) m/s.
  [[nodiscard]] static TyreForce tyre(double wheel_speed_rad_s, double along_m_s, double across_m_s,
                                      double load_N, double friction) noexcept;

  static void derivative(const double* x, const double* u, const double* p, const double* d,
                         double* dx);
  static void measure(const double* x, const double* u, const double* p, const double* d,
                      double* y);
};

}  // namespace faultline

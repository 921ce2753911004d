#pragma once

#include <cstddef>

#include "sim/plant_equations.h"

namespace faultline {

/// Amira's DTS200: three cylinders in a row, 1 - 3 - 2, two pumps, an outlet at tank 2.
///
///   A h1' = q1 - Q13                      - leak1·√(2 g h1)
///   A h2' = q2 + Q32 - Q20                - leak2·√(2 g h2)
///   A h3' = Q13 - Q32 + inflow            - leak3·√(2 g h3)
///   Q_ij  = (1 - plug_ij) az_ij S_n·torricelli(h_i - h_j)
///
/// q a pump's flow, between 0 and what it can deliver. A tank that is full runs over: its level
/// stays at the rim. y = h + noise. Flows in m³/s, leaks in m² (opening, contraction included).
struct ThreeTank {
  static constexpr double kGravity_m_s2 = 9.81;
  static constexpr double kTankArea_m2 = 0.0154;
  static constexpr double kPipeArea_m2 = 5e-5;
  static constexpr double kOutflow13 = 0.5;    ///< az_13, dimensionless
  static constexpr double kOutflow32 = 0.5;    ///< az_32
  static constexpr double kOutflow20 = 0.675;  ///< az_20
  static constexpr double kRim_m = 0.62;
  static constexpr double kPumpMost_m3_s = 1.2e-4;
  /// Below this head a pipe of 8 mm flows laminar rather than turbulent (Re < 2000 at 0.15 m/s),
  /// and √ would have no Lipschitz constant: levels that meet would never come to rest.
  static constexpr double kLaminarHead_m = 1e-3;

  static constexpr const char* name = "three_tank";
  static constexpr const char* description = "three-tank system DTS200 with leaks and plugs";
  static constexpr const char* source =
      "Amira DTS200; parameters: Theilliol, Noura, Ponsart, ISA Transactions 41 (2002)";
  static constexpr PlantSignal states[] = {
      {"h1", "m", 0.40, 0.1}, {"h2", "m", 0.20, 0.1}, {"h3", "m", 0.30, 0.1}};
  static constexpr PlantSignal inputs[] = {{"pump1", "m3/s", 3.5018e-5, 3e-5},
                                           {"pump2", "m3/s", 3.1838e-5, 3e-5}};
  static constexpr PlantSignal outputs[] = {
      {"level1", "m", 0, 0.1}, {"level2", "m", 0, 0.1}, {"level3", "m", 0, 0.1}};
  static constexpr PlantSignal parameters[] = {{"leak1", "m2", 0, 4e-6}, {"leak2", "m2", 0, 4e-6},
                                               {"leak3", "m2", 0, 4e-6}, {"plug13", "", 0, 0.3},
                                               {"plug32", "", 0, 0.3},   {"plug20", "", 0, 0.15}};
  static constexpr PlantSignal disturbances[] = {{"inflow", "m3/s", 0, 5e-7},
                                                 {"noise1", "m", 0, 5e-4},
                                                 {"noise2", "m", 0, 5e-4},
                                                 {"noise3", "m", 0, 5e-4}};

  /// sign(Δh)·√(2 g |Δh|); below the laminar head the odd cubic that continues it with its slope.
  [[nodiscard]] static double torricelli(double head_m) noexcept;

  static void derivative(const double* x, const double* u, const double* p, const double* d,
                         double* dx);
  static void measure(const double* x, const double* u, const double* p, const double* d,
                      double* y);

  /// Three rims; then where each of the five heads (h1 - h3, h3 - h2, h1, h2, h3) turns laminar.
  static constexpr std::size_t event_count = 8;
  static void events(const double* x, const double* u, const double* p, const double* d, double* g);
  /// A tank that is full stays at its rim. Elsewhere only a derivative of f jumps.
  static void on_event(std::size_t event, const double* u, const double* p, const double* d,
                       double* x);
};

}  // namespace faultline

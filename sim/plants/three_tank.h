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
/// stays at the rim. y = h + noise. In cm and ml/s, as the laboratory reads them: a fault of size
/// one is then one that matters, 1 ml/s of 35, 1 cm of 20. Leaks are openings in mm², contraction
/// included.
struct ThreeTank {
  static constexpr double kGravity_cm_s2 = 981.0;
  static constexpr double kTankArea_cm2 = 154.0;
  static constexpr double kPipeArea_cm2 = 0.5;
  static constexpr double kOutflow13 = 0.5;    ///< az_13, dimensionless
  static constexpr double kOutflow32 = 0.5;    ///< az_32
  static constexpr double kOutflow20 = 0.675;  ///< az_20
  static constexpr double kRim_cm = 62.0;
  static constexpr double kPumpMost_ml_s = 120.0;
  /// Below this head a pipe of 8 mm flows laminar rather than turbulent (Re < 2000 at 0.15 m/s),
  /// and √ would have no Lipschitz constant: levels that meet would never come to rest.
  static constexpr double kLaminarHead_cm = 0.1;

  static constexpr const char* name = "three_tank";
  static constexpr const char* description = "three-tank system DTS200 with leaks and plugs";
  static constexpr const char* source =
      "Amira DTS200; parameters: Theilliol, Noura, Ponsart, ISA Transactions 41 (2002)";
  static constexpr PlantSignal states[] = {
      {"h1", "cm", 40, 10}, {"h2", "cm", 20, 10}, {"h3", "cm", 30, 10}};
  static constexpr PlantSignal inputs[] = {{"pump1", "ml/s", 35.018, 30},
                                           {"pump2", "ml/s", 31.838, 30}};
  static constexpr PlantSignal outputs[] = {
      {"level1", "cm", 0, 5}, {"level2", "cm", 0, 5}, {"level3", "cm", 0, 5}};
  static constexpr PlantSignal parameters[] = {{"leak1", "mm2", 0, 1}, {"leak2", "mm2", 0, 1},
                                               {"leak3", "mm2", 0, 1}, {"plug13", "", 0, 0.1},
                                               {"plug32", "", 0, 0.1}, {"plug20", "", 0, 0.05}};
  static constexpr PlantSignal disturbances[] = {{"inflow", "ml/s", 0, 0.2},
                                                 {"noise1", "cm", 0, 0.02},
                                                 {"noise2", "cm", 0, 0.02},
                                                 {"noise3", "cm", 0, 0.02}};

  /// sign(Δh)·√(2 g |Δh|); below the laminar head the odd cubic that continues it with its slope.
  [[nodiscard]] static double torricelli(double head_cm) noexcept;

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

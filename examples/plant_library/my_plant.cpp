// A plant of one's own on the bench: a tank with a pump, a level sensor and a leak.
//
//   A h' = q - (a + leak) √(2 g h) + inflow        level = h + hum
//
// Everything is absolute and in the units given here; sim/plant_table.h says what each number
// means.
#include <algorithm>
#include <cmath>

#include "sim/plant_equations.h"

struct MyPlant {
  static constexpr const char* name = "my_tank";
  static constexpr const char* description = "a tank, a pump, a level sensor";
  static constexpr const char* source = "Torricelli; a tank of 0.0154 m2 with a hole of 2e-5 m2";

  // Name, unit, value at the operating point, largest deviation to be expected.
  static constexpr faultline::PlantSignal states[] = {{"h", "m", 0.3, 0.1}};
  static constexpr faultline::PlantSignal inputs[] = {{"pump", "m3/s", 4.85e-5, 3e-5}};
  static constexpr faultline::PlantSignal outputs[] = {{"level", "m", 0, 0.1}};
  // Name, unit, value, what counts as a fault of size one.
  static constexpr faultline::PlantSignal parameters[] = {{"leak", "m2", 0, 4e-6}};
  // Name, unit, 0, bound. One that reaches outputs alone is noise.
  static constexpr faultline::PlantSignal disturbances[] = {{"inflow", "m3/s", 0, 1e-7},
                                                            {"hum", "m", 0, 1e-4}};

  static void derivative(const double* x, const double* u, const double* p, const double* d,
                         double* dx) {
    constexpr double kArea_m2 = 0.0154, kHole_m2 = 2e-5, kGravity_m_s2 = 9.81;
    const double outflow = (kHole_m2 + p[0]) * std::sqrt(2.0 * kGravity_m_s2 * std::max(x[0], 0.0));
    dx[0] = (std::max(u[0], 0.0) - outflow + d[0]) / kArea_m2;
  }

  static void measure(const double* x, const double* /*u*/, const double* /*p*/, const double* d,
                      double* y) {
    y[0] = x[0] + d[1];
  }
};

FAULTLINE_PLANT(MyPlant)  // the library's entry point

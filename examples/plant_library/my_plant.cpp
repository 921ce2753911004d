// A plant of one's own on the bench: a tank that a pump fills and that drains through a hole, with
// a level sensor, a flow meter in the drain, and a leak that nobody measures.
//
//   A h' = q - (a + leak) √(2 g h) + inflow     level = h + hum     drain = a √(2 g h) + ripple
//
// Everything is absolute and in the units given here; sim/plant_table.h says what each number
// means. The functions must be pure: the same arguments, the same results, no memory.
#include <algorithm>
#include <cmath>

#include "sim/plant_equations.h"

struct MyPlant {
  static constexpr const char* name = "my_tank";
  static constexpr const char* description = "a tank, a pump, a level sensor, a flow meter";
  static constexpr const char* source = "Torricelli; a tank of 154 cm2 with a hole of 20 mm2";

  // Name, unit, value at the operating point, largest deviation to be expected.
  static constexpr faultline::PlantSignal states[] = {{"h", "cm", 30, 5}};
  static constexpr faultline::PlantSignal inputs[] = {{"pump", "ml/s", 48.5, 30}};
  static constexpr faultline::PlantSignal outputs[] = {{"level", "cm", 0, 5},
                                                       {"drain", "ml/s", 0, 5}};
  // Name, unit, value, what counts as a fault of size one.
  static constexpr faultline::PlantSignal parameters[] = {{"leak", "mm2", 0, 1}};
  // Name, unit, 0, bound. One that reaches outputs alone becomes a noise source.
  static constexpr faultline::PlantSignal disturbances[] = {
      {"inflow", "ml/s", 0, 0.1}, {"hum", "cm", 0, 0.02}, {"ripple", "ml/s", 0, 0.05}};

  // √(2 g h) in cm/s; an empty tank gives nothing.
  static double speed(double h) { return std::sqrt(2.0 * 981.0 * std::max(h, 0.0)); }

  static void derivative(const double* x, const double* u, const double* p, const double* d,
                         double* dx) {
    const double hole_cm2 = 0.2 + 0.01 * p[0];
    dx[0] = (std::max(u[0], 0.0) - hole_cm2 * speed(x[0]) + d[0]) / 154.0;
  }
  static void measure(const double* x, const double* /*u*/, const double* /*p*/, const double* d,
                      double* y) {
    y[0] = x[0] + d[1];
    y[1] = 0.2 * speed(x[0]) + d[2];
  }
};

FAULTLINE_PLANT(MyPlant)  // the library's entry point

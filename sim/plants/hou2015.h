#pragma once

#include "sim/plant_equations.h"

namespace faultline {

/// Hou's plant: four actuators on three states, unstable; examples/hou2015/plant.toml is the same.
///
///   x1' = x1 + x2 + x3 + u1 + u3 + u4     y1 = x2
///   x2' = -x2 + 2 x3 + u2 + u3            y2 = x3
///   x3' = 2 x1 - 4 x3 + u2 + u4           y3 = x1 + 2 x3
struct Hou2015 {
  static constexpr const char* name = "hou2015";
  static constexpr const char* description = "four actuators on three states, linear, unstable";
  static constexpr const char* source =
      "Hou, Cheng, Hu, Jin, Acta Automatica Sinica 41(6), 2015, section 3";
  static constexpr PlantSignal states[] = {{"x1", "", 0, 1}, {"x2", "", 0, 1}, {"x3", "", 0, 1}};
  // 100: what a plant file without `range` says of its channels.
  static constexpr PlantSignal inputs[] = {
      {"u1", "", 0, 100}, {"u2", "", 0, 100}, {"u3", "", 0, 100}, {"u4", "", 0, 100}};
  static constexpr PlantSignal outputs[] = {
      {"y1", "", 0, 100}, {"y2", "", 0, 100}, {"y3", "", 0, 100}};

  static void derivative(const double* x, const double* u, const double* p, const double* d,
                         double* dx);
  static void measure(const double* x, const double* u, const double* p, const double* d,
                      double* y);
};

}  // namespace faultline

#pragma once

#include <concepts>
#include <cstddef>
#include <iterator>

#include "sim/plant_table.h"

namespace faultline {

using PlantSignal = faultline_plant_signal;

/// A plant in C++: a class with nothing but static members.
///
///   struct Tank {
///     static constexpr const char* name = "tank";
///     static constexpr const char* description = "one tank, one pump";
///     static constexpr const char* source = "Torricelli";
///     static constexpr PlantSignal states[] = {{"level", "m", 0.3, 0.1}};
///     static constexpr PlantSignal inputs[] = {{"pump", "m3/s", 2e-5, 1e-5}};
///     static constexpr PlantSignal outputs[] = {{"level_sensor", "m", 0, 0.1}};
///     static constexpr PlantSignal parameters[] = {{"leak", "m2", 0, 1e-6}};
///     static void derivative(const double* x, const double* u, const double* p, const double* d,
///                            double* dx);
///     static void measure(const double* x, const double* u, const double* p, const double* d,
///                         double* y);
///   };
///   FAULTLINE_PLANT(Tank)      // in a shared library: its entry point
///
/// `parameters`, `disturbances`, and `event_count` with `events` and `on_event`, may be absent.
/// What each means: plant_table.h.
template <class P>
concept PlantEquations = requires(const double* in, double* out) {
  { P::name } -> std::convertible_to<const char*>;
  { P::description } -> std::convertible_to<const char*>;
  { P::source } -> std::convertible_to<const char*>;
  { P::states[0] } -> std::convertible_to<PlantSignal>;
  { P::inputs[0] } -> std::convertible_to<PlantSignal>;
  { P::outputs[0] } -> std::convertible_to<PlantSignal>;
  P::derivative(in, in, in, in, out);
  P::measure(in, in, in, in, out);
};

/// The table of a plant in C++.
template <PlantEquations P>
[[nodiscard]] const faultline_plant_table& plant_table() {
  static const faultline_plant_table table = [] {
    faultline_plant_table made{};
    made.version = FAULTLINE_PLANT_VERSION;
    made.size = sizeof(faultline_plant_table);
    made.name = P::name;
    made.description = P::description;
    made.source = P::source;
    made.state_count = std::size(P::states);
    made.states = std::data(P::states);
    made.input_count = std::size(P::inputs);
    made.inputs = std::data(P::inputs);
    made.output_count = std::size(P::outputs);
    made.outputs = std::data(P::outputs);
    if constexpr (requires { P::parameters[0]; }) {
      made.parameter_count = std::size(P::parameters);
      made.parameters = std::data(P::parameters);
    }
    if constexpr (requires { P::disturbances[0]; }) {
      made.disturbance_count = std::size(P::disturbances);
      made.disturbances = std::data(P::disturbances);
    }
    made.derivative = &P::derivative;
    made.measure = &P::measure;
    if constexpr (requires { P::event_count; }) {
      made.event_count = P::event_count;
      made.events = &P::events;
      made.on_event = &P::on_event;
    }
    return made;
  }();
  return table;
}

}  // namespace faultline

/// Makes a shared library of a plant in C++.
#define FAULTLINE_PLANT(Type)                                                    \
  extern "C" __attribute__((visibility("default"))) const faultline_plant_table* \
  faultline_plant_v1(void) {                                                     \
    return &faultline::plant_table<Type>();                                      \
  }

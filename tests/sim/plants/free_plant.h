#pragma once

#include <array>
#include <cstddef>
#include <iterator>

#include "sim/plant_equations.h"

namespace faultline {

/// A plant by its equations alone, for tests of its physics: state, inputs, parameters and
/// disturbances at nominal, and a Runge-Kutta step of order 4 that is not the bench's.
template <PlantEquations P>
class FreePlant {
 public:
  static constexpr std::size_t n = std::size(P::states);
  static constexpr std::size_t m = std::size(P::inputs);
  using State = std::array<double, n>;

  FreePlant() {
    for (std::size_t i = 0; i < n; ++i) x[i] = P::states[i].nominal;
    for (std::size_t i = 0; i < m; ++i) u[i] = P::inputs[i].nominal;
    if constexpr (requires { P::parameters[0]; }) {
      for (std::size_t i = 0; i < std::size(P::parameters); ++i) p[i] = P::parameters[i].nominal;
    }
  }

  [[nodiscard]] State derivative(const State& at) const {
    State dx{};
    P::derivative(at.data(), u.data(), p.data(), d.data(), dx.data());
    return dx;
  }
  [[nodiscard]] State derivative() const { return derivative(x); }

  void step(double h_s) {
    const State k1 = derivative(x);
    const State k2 = derivative(ahead(k1, h_s / 2.0));
    const State k3 = derivative(ahead(k2, h_s / 2.0));
    const State k4 = derivative(ahead(k3, h_s));
    for (std::size_t i = 0; i < n; ++i) {
      x[i] += h_s / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
    }
  }
  void run(double duration_s, double h_s) {
    const auto steps = static_cast<std::size_t>(duration_s / h_s + 0.5);
    for (std::size_t k = 0; k < steps; ++k) step(h_s);
  }

  State x{};
  std::array<double, m> u{};
  std::array<double, 16> p{};  // more than any of them has
  std::array<double, 16> d{};

 private:
  [[nodiscard]] State ahead(const State& k, double h_s) const {
    State at = x;
    for (std::size_t i = 0; i < n; ++i) at[i] += h_s * k[i];
    return at;
  }
};

}  // namespace faultline

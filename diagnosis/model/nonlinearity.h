#pragma once

#include <string>
#include <vector>

namespace faultline {

enum class FunctionKind : unsigned char {
  kSin,         ///< sin s
  kCos,         ///< cos s
  kTanh,        ///< tanh s
  kAtan,        ///< atan s
  kDeadZone,    ///< 0 for |s| <= width, else s - sign(s)·width
  kSaturation,  ///< s clamped to ±width
  kPolynomial,  ///< Σ coefficients[i]·s^i on [domain_min, domain_max], continued along its tangents
  kTable,       ///< linear between the points (at, value), constant beyond the first and the last
};

/// A scalar Lipschitz function φ, defined on the whole line.
struct NonlinearFunction {
  FunctionKind kind = FunctionKind::kSin;
  double width = 0.0;                ///< dead zone, saturation: > 0
  std::vector<double> coefficients;  ///< polynomial: c_0 first; at least one
  double domain_min = 0.0;           ///< polynomial: where it holds, ..
  double domain_max = 0.0;           ///< .. domain_min < domain_max
  std::vector<double> at, value;     ///< table: at least two points, `at` strictly increasing

  friend bool operator==(const NonlinearFunction&, const NonlinearFunction&) = default;
};

/// φ(s). Real-time: neither allocates nor throws.
[[nodiscard]] double evaluate(const NonlinearFunction& function, double s) noexcept;

/// The slopes of a function: (φ(a) - φ(b)) / (a - b) lies in [min, max] for all a, b.
struct SlopeBounds {
  double min = 0.0;
  double max = 0.0;
};

/// The smallest such bounds. Exact; of a polynomial to rounding.
[[nodiscard]] SlopeBounds slope_bounds(const NonlinearFunction& function);

/// "sin", "cos", "tanh", "atan", "dead_zone", "saturation", "polynomial", "table".
[[nodiscard]] std::string function_name(FunctionKind kind);

}  // namespace faultline

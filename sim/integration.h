#pragma once

#include <optional>
#include <string_view>

#include "diagnosis/model/plant_model.h"

namespace faultline {

/// How the simulator takes a plant from one sample to the next, T later. Commands, faults,
/// disturbances and noise are held over the sample in all of them.
enum class IntegrationMethod {
  kExact,          ///< linear plants: A_d = exp(A T); plants in discrete time: their own equation
  kZoh,            ///< the linear part exactly, φ(E_i x_k) held over the sample
  kEuler,          ///< x_k+1 = x_k + T f(x_k)
  kRk4,            ///< the classical Runge-Kutta method of order 4, in `substeps` equal steps
  kDormandPrince,  ///< Runge-Kutta of order 5(4), steps controlled to the tolerances
};

struct Integration {
  /// Absent: kExact for linear plants and those in discrete time, kRk4 for all others.
  std::optional<IntegrationMethod> method;
  int substeps = 10;  ///< kRk4: steps per sample, 1 .. kMostSubsteps
  double absolute_tolerance = 1e-9, relative_tolerance = 1e-9;  ///< kDormandPrince
};

/// More than this is a slip: 1000 steps per sample of a 1 kHz bench resolve a nanosecond's change.
inline constexpr int kMostSubsteps = 1000;

/// "exact", "zoh", "euler", "rk4", "dormand_prince".
[[nodiscard]] std::string_view integration_method_name(IntegrationMethod method) noexcept;

/// The method by which `plant` is stepped.
/// @throws std::invalid_argument kExact for a nonlinear plant in continuous time; anything else for
///   a plant in discrete time; substeps out of range; tolerances not positive.
[[nodiscard]] IntegrationMethod method_for(const PlantModel& plant, const Integration& integration);

/// The method by which a plant in C++ is stepped: kRk4 if absent.
/// @throws std::invalid_argument neither kRk4 nor kDormandPrince; else as method_for.
[[nodiscard]] IntegrationMethod method_for_equations(const Integration& integration);

}  // namespace faultline

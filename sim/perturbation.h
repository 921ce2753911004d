#pragma once

#include <optional>
#include <string>
#include <string_view>

#include <Eigen/Core>

namespace faultline {

/// How a disturbance or a noise source moves.
enum class PerturbationKind {
  kUniform,   ///< size·ξ_k, ξ_k drawn from [-1, 1) anew each sample
  kConstant,  ///< size
  kSinusoid,  ///< size·sin(2π f (t - at_s) + phase)
};

[[nodiscard]] std::string_view perturbation_kind_name(PerturbationKind kind) noexcept;

/// A disturbance or a noise source of the plant file at work, from at_s on and before until_s. Held
/// over each sample.
struct Perturbation {
  std::string target;  ///< a name in the plant file, or "all"
  PerturbationKind kind = PerturbationKind::kUniform;
  std::optional<double> size;  ///< absent: the bound that the plant file gives
  double frequency_Hz = 0.0;   ///< kSinusoid: > 0
  double phase_rad = 0.0;      ///< kSinusoid
  double at_s = 0.0;
  std::optional<double> until_s;
};

/// What acts in one sample: d in state and output equation, w in the output equation, one number
/// per [[disturbance]] and [[noise]] of the plant file, in its order. Both empty: nothing acts.
struct ActivePerturbations {
  Eigen::VectorXd disturbance, noise;
};

}  // namespace faultline

#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include <Eigen/Core>

#include "sim/recorded_signal.h"

namespace faultline {

/// How a disturbance or a noise source moves. What is drawn is MT19937-64's, the same everywhere;
/// uniform numbers and constants are the same to the bit on every machine; normal ones (Boost's
/// ziggurat), sinusoids and filters but for the last bits of exp, log, sin and tan.
enum class PerturbationKind {
  kUniform,      ///< size·ξ_k, ξ_k drawn from [-1, 1) anew each sample
  kConstant,     ///< size
  kSinusoid,     ///< size·sin(2π f (t - at_s) + phase)
  kGaussian,     ///< normal, standard deviation sigma
  kBandLimited,  ///< white Gaussian noise filtered to [from_Hz, to_Hz], standard deviation sigma
  kRecorded,     ///< size (1 if absent) times a column of a CSV file, whose first row is at at_s
};

[[nodiscard]] std::string_view perturbation_kind_name(PerturbationKind kind) noexcept;

/// A disturbance or a noise source of the plant file at work, from at_s on and before until_s. Held
/// over each sample.
struct Perturbation {
  std::string target;  ///< a name in the plant file, or "all"
  PerturbationKind kind = PerturbationKind::kUniform;
  std::optional<double> size;         ///< absent: the bound that the plant file gives
  double frequency_Hz = 0.0;          ///< kSinusoid: > 0
  double phase_rad = 0.0;             ///< kSinusoid
  std::optional<double> sigma;        ///< kGaussian, kBandLimited; absent: the plant file's
  double from_Hz = 0.0, to_Hz = 0.0;  ///< kBandLimited
  std::filesystem::path file;         ///< kRecorded
  std::string column;                 ///< kRecorded; empty: the target's name
  std::shared_ptr<const RecordedSignal> record{};  ///< kRecorded: what `file` holds, once read
  RecordedSignal::Between between = RecordedSignal::Between::kLinear;  ///< kRecorded
  bool is_repeated = false;  ///< kRecorded: begins anew at its end
  double at_s = 0.0;
  std::optional<double> until_s;
};

/// What acts in one sample: d in state and output equation, w in the output equation, one number
/// per [[disturbance]] and [[noise]] of the plant file, in its order. Both empty: nothing acts.
struct ActivePerturbations {
  Eigen::VectorXd disturbance, noise;
};

}  // namespace faultline

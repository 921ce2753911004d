#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace faultline {

/// What an injected fault does to its channel.
enum class InjectionKind {
  kBias,      ///< adds `value` (actuators, sensors, faults of the plant file)
  kGain,      ///< multiplies the channel by `value` (actuators, sensors)
  kSinusoid,  ///< adds `value`·sin(2π f (t - at_s) + phase) (as kBias)
};

[[nodiscard]] std::string_view injection_kind_name(InjectionKind kind) noexcept;

/// A fault on the timeline.
///
/// Its activity a(t) is 0 before `at_s` and from `until_s` on; it rises from 0 to 1 over `ramp_s`;
/// with `period_s` it acts in the first half of each period only. A bias adds a·value, a gain
/// multiplies by 1 + a·(value - 1), a sinusoid adds a·value·sin(2π f (t - at_s) + phase).
struct Injection {
  std::string target;  ///< an input, an output or a fault of the plant file
  InjectionKind kind = InjectionKind::kBias;
  double value = 0.0;  ///< in the channel's unit (bias), a factor (gain)
  double at_s = 0.0;
  std::optional<double> until_s;
  double ramp_s = 0.0;
  std::optional<double> period_s;
  double frequency_Hz = 0.0;  ///< kSinusoid: f > 0
  double phase_rad = 0.0;     ///< kSinusoid
};

/// a(t) of `injection`, in [0, 1].
[[nodiscard]] double activity(const Injection& injection, double t_s) noexcept;

/// What `injection` does at t_s: what it adds to its channel or, a gain, the channel's factor.
[[nodiscard]] double injected_value(const Injection& injection, double t_s) noexcept;

/// Whether t_s lies in [at_s, until_s), with half a nanosecond of slack: cycle times are multiples
/// of the sample time in floating point, and the cycle that is meant to be the first one must be
/// it.
[[nodiscard]] bool is_between(double t_s, double at_s,
                              const std::optional<double>& until_s) noexcept;

/// sin(2π·frequency·since + phase).
[[nodiscard]] double sinusoid(double since_s, double frequency_Hz, double phase_rad) noexcept;

}  // namespace faultline

#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace faultline {

/// What an injected fault does to its channel.
enum class InjectionKind {
  kBias,  ///< adds `value` (actuators, sensors, faults of the plant file)
  kGain,  ///< multiplies the channel by `value` (actuators, sensors)
};

[[nodiscard]] std::string_view injection_kind_name(InjectionKind kind) noexcept;

/// A fault on the timeline.
///
/// Its activity a(t) is 0 before `at_s` and from `until_s` on; it rises from 0 to 1 over `ramp_s`;
/// with `period_s` it acts in the first half of each period only. A bias adds a·value, a gain
/// multiplies by 1 + a·(value - 1).
struct Injection {
  std::string target;  ///< an input, an output or a fault of the plant file
  InjectionKind kind = InjectionKind::kBias;
  double value = 0.0;  ///< in the channel's unit (bias), a factor (gain)
  double at_s = 0.0;
  std::optional<double> until_s;
  double ramp_s = 0.0;
  std::optional<double> period_s;
};

/// a(t) of `injection`, in [0, 1].
[[nodiscard]] double activity(const Injection& injection, double t_s) noexcept;

}  // namespace faultline

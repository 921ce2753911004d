#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace faultline {

/// Where a fault sits. The kind says it: no kind belongs to two levels.
enum class FaultLevel {
  kPlant,   ///< an actuator, a sensor, a component of the plant
  kSignal,  ///< a value on its way into a message
  kFrame,   ///< a message on the bus, or a node's place on it
};

/// What an injected fault does. `v` is its value, `a` its activity in [0, 1].
enum class InjectionKind {
  // Plant: u is a command on its way to the plant, y a measurement, p a component.
  kBias,          ///< adds a·v (actuators, sensors, components)
  kGain,          ///< multiplies by 1 + a·(v - 1): loss of effectiveness for v < 1
  kSinusoid,      ///< adds a·v·sin(2π f (t - at_s) + phase)
  kStuck,         ///< stays at v, or without v at its last value before the onset
  kDrift,         ///< adds v·(t - at_s): v per second
  kDeadZone,      ///< actuators: |u - u₀| <= v does nothing, beyond it what is over
  kSlow,          ///< actuators: answers through a first-order lag of v seconds
  kHardOver,      ///< actuators: goes to v, or without v to the end of the channel's range
  kNoise,         ///< sensors: adds Gaussian noise of standard deviation a·v
  kDropout,       ///< sensors: reads v (0 without)
  kQuantisation,  ///< sensors: rounds to multiples of v
  // Signal
  kFrozen,   ///< the value sent stays as it was at the onset
  kOffset,   ///< adds a·v to the value sent
  kSwapped,  ///< two signals of one node carry each other's value; `with` names the other
  // Frame
  kDropped,        ///< not sent
  kDelayed,        ///< sent v cycles later (1 without)
  kDuplicated,     ///< sent v times more (1 without)
  kReordered,      ///< sent behind the next frame of its node
  kCorrupted,      ///< v bits of its payload flipped (1 without), which ones is drawn
  kWrongCrc,       ///< checksum inverted
  kFrozenCounter,  ///< alive counter stays, its checksum is right
  kWrongDlc,       ///< sent with v bytes (one less than it has without)
  kBabbling,       ///< v frames (1 without) of this id more in every cycle, payload drawn
  kBusOff,         ///< target "plant" or "controller": the node neither sends nor hears
};

/// What a fault can sit on.
enum class FaultTargetKind {
  kInput,
  kOutput,
  kComponent,
  kMessage,
  kNode,     ///< index 0 the plant's, 1 the controller's
  kId,       ///< kBabbling: index is the identifier
  kUnknown,  ///< a component of a simulated plant that is not at hand
};

/// As in scenarios: "bias", "gain", "sinusoid", "stuck", "drift", "dead_zone", "slow", "hard_over",
/// "noise", "dropout", "quantisation", "frozen", "offset", "swapped", "dropped", "delayed",
/// "duplicated", "reordered", "corrupted", "wrong_crc", "frozen_counter", "wrong_dlc", "babbling",
/// "bus_off".
[[nodiscard]] std::string_view injection_kind_name(InjectionKind kind) noexcept;
/// All kinds, in the order of the enum.
[[nodiscard]] std::span<const InjectionKind> all_injection_kinds() noexcept;
[[nodiscard]] std::optional<InjectionKind> find_injection_kind(std::string_view name) noexcept;
[[nodiscard]] FaultLevel level_of(InjectionKind kind) noexcept;

/// A fault on the timeline.
///
/// Its activity a(t) is 0 before `at_s` and from `until_s` on; it rises from 0 to 1 over `ramp_s`;
/// with `period_s` it acts in the first half of each period only, with `probability` in that share
/// of the cycles, drawn for each. `spread_s` moves the whole timeline of the fault to a later time,
/// drawn once from [0, spread_s).
struct Injection {
  std::string target;  ///< an input, an output, a component, a message or a node
  InjectionKind kind = InjectionKind::kBias;
  std::optional<double> value;  ///< v; what it means and whether it may be absent, the kind says
  double at_s = 0.0;
  std::optional<double> until_s;
  double ramp_s = 0.0;
  std::optional<double> period_s;
  double spread_s = 0.0;
  double probability = 1.0;
  double frequency_Hz = 0.0;  ///< kSinusoid: f > 0
  double phase_rad = 0.0;     ///< kSinusoid
  std::string with;           ///< kSwapped: the other signal
};

/// a(t) of `injection` in [0, 1], but for `spread_s` and `probability`, which a FaultSchedule
/// draws.
[[nodiscard]] double activity(const Injection& injection, double t_s) noexcept;

/// What an injection of activity `a` does at t_s, as TRUTH has it: what it adds to its channel
/// (bias, sinusoid, drift, offset); a gain's factor; where a stuck or dropped out channel is and a
/// hard-over goes; the half width of a dead zone, time constant in s of a lag, standard deviation
/// of noise, with the ramp; a step; how many frames, cycles, bits or bytes. NaN where the timeline
/// does not say: stuck at the last value, the end of the range, the next smaller length. 0 of the
/// kinds without a value.
[[nodiscard]] double injected_value(const Injection& injection, double a, double t_s) noexcept;

/// Whether t_s lies in [at_s, until_s), with half a nanosecond of slack: cycle times are multiples
/// of the sample time in floating point, and the cycle that is meant to be the first one must be
/// it.
[[nodiscard]] bool is_between(double t_s, double at_s,
                              const std::optional<double>& until_s) noexcept;

/// sin(2π·frequency·since + phase).
[[nodiscard]] double sinusoid(double since_s, double frequency_Hz, double phase_rad) noexcept;

}  // namespace faultline

#pragma once

#include <cstddef>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "sim/fault.h"

namespace faultline {

/// What an entry of some kind takes, and on what it may sit.
struct InjectionRule {
  enum class Value { kRequired, kOptional, kNone };

  Value value = Value::kRequired;
  double least, most;        ///< of the value, both included
  bool is_whole;             ///< it counts something: 1, 2, 3, ..
  bool has_ramp = true;      ///< may grow over ramp_s
  std::string_view meaning;  ///< of the value, with its unit: "bits to flip"
  std::span<const FaultTargetKind> targets;

  [[nodiscard]] bool allows(FaultTargetKind target) const noexcept;
};

[[nodiscard]] const InjectionRule& rule_of(InjectionKind kind) noexcept;

/// Whether an entry of `kind` may have `key`, one of the keys of [[fault]]; `target`, `kind`,
/// `at_s`, `until_s`, `period_s`, `spread_s`, `probability` all may.
[[nodiscard]] bool takes_key(InjectionKind kind, std::string_view key) noexcept;

/// "one input or output"; for messages.
[[nodiscard]] std::string target_kinds_text(const InjectionRule& rule);

/// What is wrong with one field of an injection: "found .., expected ..".
struct InjectionMistake {
  std::string field, text;
};

/// What is wrong with `injection` by itself, whatever the plant: a value missing, superfluous or
/// out of range; numbers that are not finite; an end before the onset, a ramp longer than the fault
/// lasts, a probability outside (0, 1], ..
/// @param sample_time_s of the run: a period must have room for a cycle on and a cycle off, a
///   sinusoid stay below half the sample rate; 0: not known, not checked.
[[nodiscard]] std::optional<InjectionMistake> find_mistake(const Injection& injection,
                                                           double sample_time_s = 0.0);

/// Whether two entries on one target contradict each other while both act: only one value can be
/// what a channel is stuck at.
[[nodiscard]] bool exclude_each_other(InjectionKind a, InjectionKind b) noexcept;

}  // namespace faultline

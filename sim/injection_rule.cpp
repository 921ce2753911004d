#include "sim/injection_rule.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include <fmt/format.h>

namespace faultline {
namespace {

using enum FaultTargetKind;
using Value = InjectionRule::Value;

constexpr std::array kAnywhere{kInput, kOutput, kComponent};
constexpr std::array kChannels{kInput, kOutput};
constexpr std::array kInputs{kInput};
constexpr std::array kOutputs{kOutput};
constexpr std::array kMessages{kMessage};
constexpr std::array kMessagesOrIds{kMessage, kId};
constexpr std::array kNodes{kNode};

constexpr double kAny = std::numeric_limits<double>::max();
constexpr double kPositive = std::numeric_limits<double>::min();
/// A message that comes later than this is lost to everyone: a gap of more than 100 cycles resets
/// the diagnosis (docs/design.md, "The cycle").
constexpr double kMostDelayCycles = 100;
/// Frames more per cycle: enough to fill any bus at any rate of a bench.
constexpr double kMostFrames = 100;
constexpr double kMostBits = 512;  // of the 64 bytes of a CAN FD frame
constexpr double kMostBytes = 64;  // of a CAN FD frame

constexpr InjectionRule number(std::string_view meaning, std::span<const FaultTargetKind> targets,
                               double least = -kAny) {
  return {Value::kRequired, least, kAny, false, true, meaning, targets};
}
constexpr InjectionRule place(std::string_view meaning, std::span<const FaultTargetKind> targets,
                              bool has_ramp = false) {
  return {Value::kOptional, -kAny, kAny, false, has_ramp, meaning, targets};
}
constexpr InjectionRule count(std::string_view meaning, double least, double most,
                              std::span<const FaultTargetKind> targets) {
  return {Value::kOptional, least, most, true, false, meaning, targets};
}
constexpr InjectionRule plain(std::span<const FaultTargetKind> targets) {
  return {Value::kNone, 0.0, 0.0, false, false, "", targets};
}
constexpr InjectionRule without_ramp(InjectionRule rule) {
  rule.has_ramp = false;
  return rule;
}

/// In the order of InjectionKind.
constexpr std::array kRules{
    number("what is added", kAnywhere),
    number("the factor", kAnywhere),
    number("the amplitude", kAnywhere),
    place("what it is stuck at", kChannels),
    without_ramp(number("the drift per second", kAnywhere)),
    number("the half width", kInputs, kPositive),
    number("the time constant in seconds", kInputs, kPositive),
    place("where it goes", kInputs, true),
    number("the standard deviation", kOutputs, kPositive),
    place("what it reads", kOutputs),
    without_ramp(number("the step", kOutputs, kPositive)),
    plain(kChannels),
    number("what is added", kChannels),
    plain(kChannels),
    plain(kMessages),
    count("cycles late", 1, kMostDelayCycles, kMessages),
    count("frames more", 1, kMostFrames, kMessages),
    plain(kMessages),
    count("bits to flip", 1, kMostBits, kMessages),
    plain(kMessages),
    plain(kMessages),
    count("bytes", 0, kMostBytes, kMessages),
    count("frames more per cycle", 1, kMostFrames, kMessagesOrIds),
    plain(kNodes),
};
static_assert(kRules.size() == static_cast<std::size_t>(InjectionKind::kBusOff) + 1);

std::string_view name_of(FaultTargetKind kind) {
  switch (kind) {
    case kInput:
      return "input";
    case kOutput:
      return "output";
    case kComponent:
      return "component";
    case kMessage:
      return "message";
    case kNode:
      return "node";
    case kId:
      return "identifier";
    case kUnknown:
      break;
  }
  return "";
}

/// "a positive number", "1 to 100 (bits to flip)".
std::string range_text(const InjectionRule& rule) {
  std::string range = "a number";
  if (rule.is_whole) {
    range = fmt::format("a whole number from {} to {}", rule.least, rule.most);
  } else if (rule.least > 0.0) {
    range = "a positive number";
  }
  return fmt::format("{} ({})", range, rule.meaning);
}

std::optional<std::string> mistake_of_value(const Injection& injection) {
  const InjectionRule& rule = rule_of(injection.kind);
  const std::string_view kind = injection_kind_name(injection.kind);
  if (!injection.value) {
    if (rule.value != Value::kRequired) return std::nullopt;
    return fmt::format("found nothing, expected {} with kind = \"{}\"", range_text(rule), kind);
  }
  const double value = *injection.value;
  if (rule.value == Value::kNone) {
    return fmt::format("found {}, expected none with kind = \"{}\"", value, kind);
  }
  const bool is_within = value >= rule.least && value <= rule.most;  // false of a NaN
  if (is_within && (!rule.is_whole || value == std::floor(value))) return std::nullopt;
  return fmt::format("found {}, expected {} with kind = \"{}\"", value, range_text(rule), kind);
}

std::optional<InjectionMistake> mistake_of_times(const Injection& injection, double sample_time_s) {
  struct Time {
    const char* field;
    double value;
  };
  for (const Time& time : {Time{"at_s", injection.at_s}, Time{"ramp_s", injection.ramp_s},
                           Time{"spread_s", injection.spread_s}}) {
    if (std::isfinite(time.value) && time.value >= 0.0) continue;
    return InjectionMistake{time.field,
                            fmt::format("found {}, expected zero or more seconds", time.value)};
  }
  if (const auto until_s = injection.until_s) {
    if (!(*until_s > injection.at_s) || !std::isfinite(*until_s)) {
      return InjectionMistake{"until_s", fmt::format("found {}, expected more than at_s = {}",
                                                     *until_s, injection.at_s)};
    }
    if (injection.ramp_s > *until_s - injection.at_s) {
      return InjectionMistake{
          "ramp_s", fmt::format("found {}, expected at most the {:.6g} s that the fault lasts",
                                injection.ramp_s, *until_s - injection.at_s)};
    }
  }
  if (const auto period_s = injection.period_s) {
    if (!(*period_s > 0.0) || !std::isfinite(*period_s)) {
      return InjectionMistake{"period_s",
                              fmt::format("found {}, expected a positive number", *period_s)};
    }
    // Half a cycle's slack of rounding would be too much, none too little.
    if (*period_s < 2.0 * sample_time_s * (1.0 - 1e-9)) {
      return InjectionMistake{
          "period_s", fmt::format("found {}, expected room for a cycle on and a cycle off: at "
                                  "least {} s",
                                  *period_s, 2.0 * sample_time_s)};
    }
  }
  return std::nullopt;
}

std::optional<InjectionMistake> mistake_of_sinusoid(const Injection& injection,
                                                    double sample_time_s) {
  if (injection.kind != InjectionKind::kSinusoid) {
    if (injection.frequency_Hz == 0.0 && injection.phase_rad == 0.0) return std::nullopt;
    return InjectionMistake{"frequency_Hz",
                            fmt::format("found it with kind = \"{}\", expected it with \"sinusoid\""
                                        " only",
                                        injection_kind_name(injection.kind))};
  }
  const double frequency_Hz = injection.frequency_Hz;
  if (!(frequency_Hz > 0.0) || !std::isfinite(frequency_Hz)) {
    return InjectionMistake{"frequency_Hz",
                            fmt::format("found {}, expected a positive number", frequency_Hz)};
  }
  if (2.0 * frequency_Hz * sample_time_s >= 1.0) {
    return InjectionMistake{"frequency_Hz",
                            fmt::format("found {}, expected less than half the sample rate: {} Hz",
                                        frequency_Hz, 0.5 / sample_time_s)};
  }
  if (std::isfinite(injection.phase_rad)) return std::nullopt;
  return InjectionMistake{"phase_rad",
                          fmt::format("found {}, expected a number", injection.phase_rad)};
}

}  // namespace

bool InjectionRule::allows(FaultTargetKind target) const noexcept {
  return std::find(targets.begin(), targets.end(), target) != targets.end();
}

const InjectionRule& rule_of(InjectionKind kind) noexcept {
  return kRules[static_cast<std::size_t>(kind)];
}

bool takes_key(InjectionKind kind, std::string_view key) noexcept {
  if (key == "value") return rule_of(kind).value != Value::kNone;
  if (key == "ramp_s") return rule_of(kind).has_ramp;
  if (key == "frequency_Hz" || key == "phase_rad") return kind == InjectionKind::kSinusoid;
  if (key == "with") return kind == InjectionKind::kSwapped;
  return true;
}

std::string target_kinds_text(const InjectionRule& rule) {
  std::string text = "an ";
  if (rule.targets.front() == kMessage) text = "a ";
  if (rule.targets.front() == kNode) return "a node (plant, controller)";
  for (std::size_t i = 0; i < rule.targets.size(); ++i) {
    if (i > 0) text += i + 1 == rule.targets.size() ? " or " : ", ";
    text += name_of(rule.targets[i]);
  }
  return text;
}

std::optional<InjectionMistake> find_mistake(const Injection& injection, double sample_time_s) {
  if (auto text = mistake_of_value(injection)) return InjectionMistake{"value", std::move(*text)};
  if (auto mistake = mistake_of_times(injection, sample_time_s)) return mistake;
  const std::string_view kind = injection_kind_name(injection.kind);
  if (injection.ramp_s > 0.0 && !rule_of(injection.kind).has_ramp) {
    return InjectionMistake{
        "ramp_s",
        fmt::format("found it with kind = \"{}\", expected none: that is there or not", kind)};
  }
  if (!(injection.probability > 0.0 && injection.probability <= 1.0)) {
    return InjectionMistake{
        "probability",
        fmt::format("found {}, expected more than 0 and at most 1", injection.probability)};
  }
  if (injection.with.empty() != (injection.kind != InjectionKind::kSwapped)) {
    return InjectionMistake{
        "with",
        injection.with.empty()
            ? "found nothing, expected the other signal with kind = \"swapped\""
            : fmt::format("found it with kind = \"{}\", expected it with \"swapped\" only", kind)};
  }
  return mistake_of_sinusoid(injection, sample_time_s);
}

bool exclude_each_other(InjectionKind a, InjectionKind b) noexcept {
  using enum InjectionKind;
  const auto is_placed = [](InjectionKind kind) {
    return kind == kStuck || kind == kHardOver || kind == kDropout;
  };
  if (is_placed(a) && is_placed(b)) return true;
  return a == b && (a == kFrozen || a == kSlow || a == kSwapped || a == kWrongDlc);
}

}  // namespace faultline

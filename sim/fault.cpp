#include "sim/fault.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace faultline {
namespace {

constexpr double kSlackSeconds = 0.5e-9;  // of is_between

using enum InjectionKind;
constexpr std::array kKinds{kBias,          kGain,       kSinusoid,  kStuck,     kDrift,
                            kDeadZone,      kSlow,       kHardOver,  kNoise,     kDropout,
                            kQuantisation,  kFrozen,     kOffset,    kSwapped,   kDropped,
                            kDelayed,       kDuplicated, kReordered, kCorrupted, kWrongCrc,
                            kFrozenCounter, kWrongDlc,   kBabbling,  kBusOff};
constexpr std::array<std::string_view, kKinds.size()> kNames{
    "bias",      "gain",      "sinusoid",       "stuck",     "drift",        "dead_zone",
    "slow",      "hard_over", "noise",          "dropout",   "quantisation", "frozen",
    "offset",    "swapped",   "dropped",        "delayed",   "duplicated",   "reordered",
    "corrupted", "wrong_crc", "frozen_counter", "wrong_dlc", "babbling",     "bus_off"};

}  // namespace

std::string_view injection_kind_name(InjectionKind kind) noexcept {
  return kNames[static_cast<std::size_t>(kind)];
}

std::span<const InjectionKind> all_injection_kinds() noexcept { return kKinds; }

std::optional<InjectionKind> find_injection_kind(std::string_view name) noexcept {
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) return std::nullopt;
  return kKinds[static_cast<std::size_t>(found - kNames.begin())];
}

FaultLevel level_of(InjectionKind kind) noexcept {
  if (kind < kFrozen) return FaultLevel::kPlant;
  return kind < kDropped ? FaultLevel::kSignal : FaultLevel::kFrame;
}

bool is_between(double t_s, double at_s, const std::optional<double>& until_s) noexcept {
  if (t_s - at_s + kSlackSeconds < 0.0) return false;
  return !(until_s && t_s + kSlackSeconds >= *until_s);
}

double sinusoid(double since_s, double frequency_Hz, double phase_rad) noexcept {
  return std::sin(2.0 * std::numbers::pi * frequency_Hz * since_s + phase_rad);
}

double activity(const Injection& injection, double t_s) noexcept {
  if (!is_between(t_s, injection.at_s, injection.until_s)) return 0.0;
  const double since_s = t_s - injection.at_s + kSlackSeconds;
  if (injection.period_s && std::fmod(since_s, *injection.period_s) >= 0.5 * *injection.period_s) {
    return 0.0;
  }
  if (injection.ramp_s > 0.0) return std::min(1.0, since_s / injection.ramp_s);
  return 1.0;
}

double injected_value(const Injection& injection, double a, double t_s) noexcept {
  constexpr double kNotSaid = std::numeric_limits<double>::quiet_NaN();
  const double value = injection.value.value_or(0.0);
  const double since_s = t_s - injection.at_s;
  switch (injection.kind) {
    case kGain:
      return 1.0 + a * (value - 1.0);
    case kSinusoid:
      return a * value * sinusoid(since_s, injection.frequency_Hz, injection.phase_rad);
    case kDrift:
      return a * value * since_s;
    case kStuck:
    case kHardOver:
    case kWrongDlc:
      return injection.value.value_or(kNotSaid);
    case kDropout:
      return value;
    case kDelayed:
    case kDuplicated:
    case kCorrupted:
    case kBabbling:
      return injection.value.value_or(1.0);
    default:
      return a * value;
  }
}

}  // namespace faultline

#include "sim/actuator.h"

#include <algorithm>
#include <cmath>

namespace faultline {
namespace {

/// Relative to the command (and at least this): what a lag has left when it is forgotten. Far below
/// what any message resolves.
constexpr double kFadedShare = 1e-12;

}  // namespace

Actuator::Actuator(double operating, double sample_time_s)
    : operating_(operating), sample_time_s_(sample_time_s) {}

void Actuator::begin_cycle() noexcept {
  gain_ = 1.0;
  offset_ = dead_zone_ = time_constant_s_ = hard_over_share_ = 0.0;
  is_stuck_ = false;
}

void Actuator::add(const ActingFault& fault) noexcept {
  const Injection& injection = *fault.injection;
  switch (injection.kind) {
    case InjectionKind::kGain:
      gain_ *= fault.value;
      break;
    case InjectionKind::kDeadZone:
      dead_zone_ += fault.value;
      break;
    case InjectionKind::kSlow:
      time_constant_s_ = fault.value;
      break;
    case InjectionKind::kHardOver:
      hard_over_share_ = fault.activity;
      place_ = fault.value;
      break;
    case InjectionKind::kStuck:
      is_stuck_ = true;
      if (holder_ != fault.entry) held_ = injection.value.value_or(last_);
      holder_ = fault.entry;
      break;
    default:
      offset_ += fault.value;
      break;
  }
}

double Actuator::lagged(double command) noexcept {
  if (std::isnan(previous_)) previous_ = command;
  if (time_constant_s_ > 0.0) {
    // z_k - v_k = φ (z_k-1 - v_k); where the lag begins, z_k-1 is where the actuator was.
    const double phi = std::exp(-sample_time_s_ / time_constant_s_);
    lag_ = phi * (lag_ + previous_ - command);
    fading_s_ = time_constant_s_;
  } else if (lag_ != 0.0) {
    lag_ *= std::exp(-sample_time_s_ / fading_s_);
    if (std::abs(lag_) <= kFadedShare * std::max(1.0, std::abs(command))) lag_ = 0.0;
  }
  previous_ = command;
  return command + lag_;
}

double Actuator::respond(double command) noexcept {
  if (dead_zone_ > 0.0) {
    const double deviation = command - operating_;
    const double beyond = std::max(0.0, std::abs(deviation) - dead_zone_);
    command = operating_ + std::copysign(beyond, deviation);
  }
  double out = gain_ * lagged(command) + offset_;
  if (hard_over_share_ > 0.0) out += hard_over_share_ * (place_ - out);
  if (!is_stuck_) {
    holder_ = kNone;
  } else {
    if (std::isnan(held_)) held_ = out;
    out = held_;
  }
  last_ = out;
  return out;
}

}  // namespace faultline

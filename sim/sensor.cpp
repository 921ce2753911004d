#include "sim/sensor.h"

#include <algorithm>
#include <cmath>

namespace faultline {

void Sensor::begin_cycle() noexcept {
  gain_ = 1.0;
  offset_ = noise_ = step_ = 0.0;
  is_stuck_ = is_dropped_out_ = false;
}

void Sensor::add(const ActingFault& fault, double normal) noexcept {
  const Injection& injection = *fault.injection;
  switch (injection.kind) {
    case InjectionKind::kGain:
      gain_ *= fault.value;
      break;
    case InjectionKind::kNoise:
      noise_ += fault.value * normal;
      break;
    case InjectionKind::kQuantisation:
      step_ = std::max(step_, fault.value);
      break;
    case InjectionKind::kStuck:
      is_stuck_ = true;
      if (holder_ != fault.entry) held_ = injection.value.value_or(last_);
      holder_ = fault.entry;
      break;
    case InjectionKind::kDropout:
      is_dropped_out_ = true;
      dropout_ = fault.value;
      break;
    default:
      offset_ += fault.value;
      break;
  }
}

double Sensor::read(double y) noexcept {
  double reading = gain_ * y + offset_ + noise_;
  if (step_ > 0.0) reading = step_ * std::round(reading / step_);
  if (!is_stuck_) {
    holder_ = kNone;
  } else {
    if (std::isnan(held_)) held_ = reading;
    reading = held_;
  }
  if (is_dropped_out_) reading = dropout_;
  last_ = reading;
  return reading;
}

}  // namespace faultline

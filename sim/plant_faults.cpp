#include "sim/plant_faults.h"

#include <algorithm>
#include <limits>

#include "sim/random_draw.h"

namespace faultline {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
/// More than the slack of is_between: the first cycle of a fault is never taken for a quiet one.
constexpr double kMargin_s = 1e-6;

}  // namespace

PlantFaults::PlantFaults(const FaultSchedule& schedule, double sample_time_s)
    : schedule_(&schedule),
      sensors_(schedule.targets().outputs.size()),
      component_(schedule.targets().components.size(), 0.0),
      component_gain_(component_.size(), 1.0) {
  for (const ChannelTarget& input : schedule.targets().inputs) {
    actuators_.emplace_back(input.operating, sample_time_s);
  }
}

void PlantFaults::begin_cycle() noexcept {
  for (Actuator& actuator : actuators_) actuator.begin_cycle();
  for (Sensor& sensor : sensors_) sensor.begin_cycle();
  std::fill(component_.begin(), component_.end(), 0.0);
  std::fill(component_gain_.begin(), component_gain_.end(), 1.0);
}

double PlantFaults::next_time_s(std::size_t entry, double t_s) const noexcept {
  const Injection& injection = schedule_->injection(entry);
  const double onset_s = schedule_->onset_s(entry);
  if (onset_s > t_s) return onset_s;
  // Between two of its periods, or not drawn this time: it may act in the very next cycle.
  const bool is_over =
      injection.until_s && t_s > *injection.until_s + (onset_s - injection.at_s) + kMargin_s;
  return is_over ? kNever : t_s;
}

void PlantFaults::advance(double t_s) noexcept {
  const std::size_t entries = schedule_->size();
  if (is_quiet_ && entries == seen_entries_ && t_s < quiet_until_s_ - kMargin_s) return;
  seen_entries_ = entries;
  begin_cycle();
  is_quiet_ = std::none_of(actuators_.begin(), actuators_.end(),
                           [](const Actuator& actuator) { return actuator.is_lagging(); });
  quiet_until_s_ = kNever;
  for (std::size_t entry = 0; entry < entries; ++entry) {
    if (level_of(schedule_->injection(entry).kind) != FaultLevel::kPlant) continue;
    const double activity = schedule_->activity(entry, t_s);
    if (activity > 0.0) {
      act(entry, activity, t_s);
      is_quiet_ = false;
    } else {
      quiet_until_s_ = std::min(quiet_until_s_, next_time_s(entry, t_s));
    }
  }
  for (std::size_t i = 0; i < component_.size(); ++i) {
    component_[i] += (component_gain_[i] - 1.0) * schedule_->targets().components[i].nominal;
  }
}

void PlantFaults::act(std::size_t entry, double activity, double t_s) noexcept {
  const FaultTarget& target = schedule_->target(entry);
  const ActingFault fault{entry, &schedule_->injection(entry), activity,
                          schedule_->value(entry, t_s)};
  const InjectionKind kind = fault.injection->kind;
  if (target.kind == FaultTargetKind::kInput) {
    actuators_[target.index].add(fault);
  } else if (target.kind == FaultTargetKind::kOutput) {
    const double normal = kind == InjectionKind::kNoise ? normal_of(schedule_->draw(entry, t_s, 0),
                                                                    schedule_->draw(entry, t_s, 1))
                                                        : 0.0;
    sensors_[target.index].add(fault, normal);
  } else if (target.kind == FaultTargetKind::kComponent) {
    if (kind == InjectionKind::kGain) {
      component_gain_[target.index] *= fault.value;
    } else {
      component_[target.index] += fault.value;
    }
  }
}

void PlantFaults::actuate(std::span<const double> u, std::span<double> u_act) noexcept {
  for (std::size_t j = 0; j < u.size(); ++j) {
    if (is_quiet_) {
      actuators_[j].follow(u[j]);
      u_act[j] = u[j];
    } else {
      u_act[j] = actuators_[j].respond(u[j]);
    }
  }
}

void PlantFaults::sense(std::span<double> y) noexcept {
  for (std::size_t i = 0; i < y.size(); ++i) {
    if (is_quiet_) {
      sensors_[i].follow(y[i]);
    } else {
      y[i] = sensors_[i].read(y[i]);
    }
  }
}

}  // namespace faultline

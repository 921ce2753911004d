#include "sim/plant_faults.h"

#include <algorithm>

namespace faultline {

PlantFaults::PlantFaults(const FaultSchedule& schedule, double sample_time_s)
    : schedule_(&schedule),
      sample_time_s_(sample_time_s),
      input_gain_(schedule.targets().inputs.size()),
      input_bias_(input_gain_.size()),
      output_gain_(schedule.targets().outputs.size()),
      output_bias_(output_gain_.size()),
      component_(schedule.targets().components.size()) {
  advance(0.0);
}

void PlantFaults::advance(double t_s) noexcept {
  std::fill(input_gain_.begin(), input_gain_.end(), 1.0);
  std::fill(input_bias_.begin(), input_bias_.end(), 0.0);
  std::fill(output_gain_.begin(), output_gain_.end(), 1.0);
  std::fill(output_bias_.begin(), output_bias_.end(), 0.0);
  std::fill(component_.begin(), component_.end(), 0.0);
  for (std::size_t i = 0; i < schedule_->size(); ++i) {
    if (schedule_->activity(i, t_s) == 0.0) continue;
    const FaultTarget& target = schedule_->target(i);
    const bool is_gain = schedule_->injection(i).kind == InjectionKind::kGain;
    const double value = schedule_->value(i, t_s);
    switch (target.kind) {
      case FaultTargetKind::kInput:
        if (is_gain) {
          input_gain_[target.index] *= value;
        } else {
          input_bias_[target.index] += value;
        }
        break;
      case FaultTargetKind::kOutput:
        if (is_gain) {
          output_gain_[target.index] *= value;
        } else {
          output_bias_[target.index] += value;
        }
        break;
      case FaultTargetKind::kComponent: {
        const double nominal = schedule_->targets().components[target.index].nominal;
        component_[target.index] += is_gain ? nominal * (value - 1.0) : value;
        break;
      }
      default:
        break;
    }
  }
}

void PlantFaults::actuate(std::span<const double> u, std::span<double> u_act) noexcept {
  for (std::size_t j = 0; j < u.size(); ++j) u_act[j] = input_gain_[j] * u[j] + input_bias_[j];
}

void PlantFaults::sense(std::span<double> y) noexcept {
  for (std::size_t i = 0; i < y.size(); ++i) y[i] = output_gain_[i] * y[i] + output_bias_[i];
}

}  // namespace faultline

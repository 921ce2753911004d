#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sim/fault_schedule.h"

namespace faultline {

/// What the faults of a timeline do to actuators, to the plant's components and to sensors:
///
///   u_act = Γ_u u + b_u,   y_meas = Γ_y y + b_y,   m the deviations of the components
///
/// One object per plant node: it follows the timeline cycle by cycle.
class PlantFaults {
 public:
  /// @param schedule must outlive this; entries may be added to it meanwhile.
  PlantFaults(const FaultSchedule& schedule, double sample_time_s);

  /// The cycle at t_s begins. Real-time: neither allocates nor throws, nor do the others.
  void advance(double t_s) noexcept;
  /// What the actuators make of the command.
  void actuate(std::span<const double> u, std::span<double> u_act) noexcept;
  /// Deviations of the components from nominal, in the order of FaultTargets::components.
  [[nodiscard]] std::span<const double> components() const noexcept { return component_; }
  /// What the sensors make of y, in place.
  void sense(std::span<double> y) noexcept;

 private:
  const FaultSchedule* schedule_;
  double sample_time_s_;
  std::vector<double> input_gain_, input_bias_, output_gain_, output_bias_, component_;
};

}  // namespace faultline

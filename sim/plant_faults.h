#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "sim/actuator.h"
#include "sim/fault_schedule.h"
#include "sim/sensor.h"

namespace faultline {

/// What the faults of a timeline do to actuators, to the plant's components and to sensors:
/// actuator.h and sensor.h say what each kind does, and in which order. Of a component with nominal
/// value p₀ the deviation is (Π factors - 1)·p₀ + biases + sinusoids + drifts.
///
/// One object per plant node: it follows the timeline cycle by cycle. While nothing acts, a cycle
/// costs a comparison and a copy of the channels.
class PlantFaults {
 public:
  /// @param schedule must outlive this; entries may be added to it meanwhile.
  PlantFaults(const FaultSchedule& schedule, double sample_time_s);

  /// The cycle at t_s begins; t_s grows from call to call. Real-time: neither allocates nor throws,
  /// nor do the others.
  void advance(double t_s) noexcept;
  /// What the actuators make of the command; once per cycle. `u_act` may be `u`.
  void actuate(std::span<const double> u, std::span<double> u_act) noexcept;
  /// Deviations of the components from nominal, in the order of FaultTargets::components.
  [[nodiscard]] std::span<const double> components() const noexcept { return component_; }
  /// What the sensors make of y, in place; once per cycle.
  void sense(std::span<double> y) noexcept;

 private:
  void begin_cycle() noexcept;
  /// An entry that acts now.
  void act(std::size_t entry, double activity, double t_s) noexcept;
  /// When an entry that does not act at t_s may act next: infinity if it never will.
  [[nodiscard]] double next_time_s(std::size_t entry, double t_s) const noexcept;

  const FaultSchedule* schedule_;
  std::vector<Actuator> actuators_;
  std::vector<Sensor> sensors_;
  std::vector<double> component_;
  std::vector<double> component_gain_;
  std::size_t seen_entries_ = 0;
  bool is_quiet_ = true;        // nothing acts in this cycle
  double quiet_until_s_ = 0.0;  // nor does any of the seen entries before
};

}  // namespace faultline

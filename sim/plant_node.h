#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "drivers/can/can_bus.h"
#include "drivers/signal/cycle_counter.h"
#include "drivers/signal/message_integrity.h"
#include "drivers/signal/signal_map.h"
#include "sim/fault_schedule.h"
#include "sim/integration.h"
#include "sim/message_assembler.h"
#include "sim/perturbation_schedule.h"
#include "sim/plant.h"
#include "sim/plant_faults.h"

namespace faultline {

/// What the simulator alone knows about a cycle.
struct PlantTruth {
  std::uint32_t cycle = 0;
  std::uint32_t command_cycle = 0;  ///< c_k that acts in the cycle, kNoCommand before the first
  bool is_late = false;             ///< it acts on an older command than the last cycle's answer
};

/// The unit under diagnosis: the plant with its actuators and sensors, as a state machine on a bus.
/// It leads the cycle (docs/design.md, "The cycle"): at t_k it latches the newest complete command,
/// sends SYNC with k and c_k, then the sensor frames of y_k, with the alive counters and checksums
/// that the map asks for; a message that is slower than the cycle (N cycles) in cycles 0, N, 2 N,
/// .. Owns no socket, thread or clock.
class PlantNode {
 public:
  /// `map` and `schedule` must outlive the node. @pre the schedule's components are the plant's
  PlantNode(std::unique_ptr<SimulatedPlant> plant, const SignalMap& map,
            const FaultSchedule& schedule, double sample_time_s, const Eigen::VectorXd& x_initial,
            PerturbationSchedule perturbations = {});
  /// The same of a plant file's plant. @throws std::invalid_argument as ModelPlant.
  PlantNode(const PlantModel& model, const SignalMap& map, const FaultSchedule& schedule,
            double sample_time_s, const Eigen::VectorXd& x_initial,
            PerturbationSchedule perturbations = {}, const Integration& integration = {});

  /// Cycle k, k = 0, 1, 2, ... in order. Real-time: does not allocate.
  void on_cycle(std::uint32_t k, FrameSink& sink) noexcept;
  /// Takes command frames; others are ignored.
  void on_frame(const CanFrame& frame) noexcept;

  /// True when the answer to cycle k is complete: the next cycle of a lock-step run may begin.
  [[nodiscard]] bool has_command(std::uint32_t k) const noexcept {
    return newest_command_ != kNoCommand && cycles_ahead(newest_command_, k) >= 0;
  }
  [[nodiscard]] const PlantTruth& truth() const noexcept { return truth_; }
  /// Absolute state at the start of the last cycle.
  [[nodiscard]] const Eigen::VectorXd& state() const noexcept { return x_; }
  /// Disturbances and noise of the last cycle.
  [[nodiscard]] const ActivePerturbations& perturbations() const noexcept { return active_; }
  [[nodiscard]] std::uint64_t late_cycles() const noexcept { return late_cycles_; }
  /// Sensor values that did not fit their signals and were sent clamped.
  [[nodiscard]] std::uint64_t clamped_values() const noexcept { return clamped_values_; }
  /// False once the plant has diverged past the finite numbers.
  [[nodiscard]] bool is_finite() const noexcept { return plant_->is_finite(); }
  /// Why not: SimulatedPlant::failure.
  [[nodiscard]] std::string failure() const { return plant_->failure(); }

 private:
  const SignalMap* map_;
  PerturbationSchedule perturbations_;
  std::unique_ptr<SimulatedPlant> plant_;
  double sample_time_s_;
  MessageAssembler commands_;
  MessageProtector sync_protector_;
  std::vector<MessageProtector> sensor_protectors_;  // per sensor message
  std::uint32_t cycle_ = 0;
  std::uint32_t newest_command_ = kNoCommand;
  std::vector<double> u_, u_act_, y_;
  Eigen::VectorXd x_;
  PlantFaults faults_;
  ActivePerturbations active_;
  PlantTruth truth_;
  std::uint64_t late_cycles_ = 0;
  std::uint64_t clamped_values_ = 0;
};

}  // namespace faultline

#include "sim/plant_node.h"

#include <algorithm>
#include <utility>

#include "drivers/signal/cycle_counter.h"
#include "sim/model_plant.h"

namespace faultline {

PlantNode::PlantNode(std::unique_ptr<SimulatedPlant> plant, const SignalMap& map,
                     const FaultSchedule& schedule, double sample_time_s,
                     const Eigen::VectorXd& x_initial, PerturbationSchedule perturbations)
    : map_(&map),
      perturbations_(std::move(perturbations)),
      plant_(std::move(plant)),
      sample_time_s_(sample_time_s),
      commands_(map.command_messages, map.input_names.size()),
      u_(map.input_names.size(), 0.0),
      u_act_(map.input_names.size(), 0.0),
      y_(map.output_names.size(), 0.0),
      x_(x_initial),
      faults_(schedule, sample_time_s),
      active_(perturbations_.none()) {
  plant_->reset(x_initial);
  if (map.sync) sync_protector_ = MessageProtector(map.sync->protection);
  sensor_protectors_ = protectors(map.sensor_messages);
}

PlantNode::PlantNode(const PlantModel& model, const SignalMap& map, const FaultSchedule& schedule,
                     double sample_time_s, const Eigen::VectorXd& x_initial,
                     PerturbationSchedule perturbations, const Integration& integration)
    : PlantNode(std::make_unique<ModelPlant>(model, sample_time_s, integration), map, schedule,
                sample_time_s, x_initial, std::move(perturbations)) {}

void PlantNode::on_cycle(std::uint32_t k, FrameSink& sink) noexcept {
  cycle_ = k;
  // Cycle 0 has no cycle before it whose answer could be missing.
  const bool is_late = k > 0 && newest_command_ != k - 1;
  truth_ = {k, newest_command_, is_late};
  if (is_late) ++late_cycles_;
  x_ = plant_->state();

  const double t_s = static_cast<double>(k) * sample_time_s_;
  faults_.advance(t_s);
  perturbations_.advance(t_s, active_);
  faults_.actuate(u_, u_act_);
  const PlantDrive drive{u_act_, faults_.components(), active_};
  plant_->measure(drive, y_);
  faults_.sense(y_);
  CanFrame frame;
  if (map_->sync) {
    map_->sync->encode(k, newest_command_, frame);
    sync_protector_.protect(frame);
    sink.send(frame);
  }
  for (std::size_t i = 0; i < sensor_protectors_.size(); ++i) {
    if (k % map_->sensor_messages[i].cycles_per_frame != 0) continue;
    clamped_values_ += map_->sensor_messages[i].encode(y_, k, frame);
    sensor_protectors_[i].protect(frame);
    sink.send(frame);
  }
  plant_->step(drive);
}

void PlantNode::on_frame(const CanFrame& frame) noexcept {
  const auto completed = commands_.push(frame, cycle_);
  if (!completed) return;
  if (newest_command_ == kNoCommand || cycles_ahead(*completed, newest_command_) > 0) {
    newest_command_ = *completed;
    const std::span<const double> command = commands_.values(*completed);
    std::copy(command.begin(), command.end(), u_.begin());
  }
}

}  // namespace faultline

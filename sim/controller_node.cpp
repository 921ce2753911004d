#include "sim/controller_node.h"

#include <utility>

namespace faultline {

ControllerNode::ControllerNode(const SignalMap& map, std::unique_ptr<Controller> controller)
    : map_(&map),
      controller_(std::move(controller)),
      measurements_(map.sensor_messages, map.output_names.size()),
      protectors_(protectors(map.command_messages)),
      u_(map.input_names.size()) {
  if (map.sync) sync_integrity_ = MessageIntegrity(map.sync->protection);
}

ControllerNode::ControllerNode(const SignalMap& map, ControlLaw law)
    : ControllerNode(map, std::make_unique<StaticFeedback>(std::move(law))) {}

void ControllerNode::on_frame(const CanFrame& frame, FrameSink& sink) noexcept {
  if (map_->sync && map_->sync->matches(frame)) {
    if (!is_usable(sync_integrity_.check(frame).status)) return;
    std::int64_t k = 0;
    if (map_->sync->cycle.decode_raw(frame.payload(), k) == CodecStatus::kOk) {
      cycle_ = static_cast<std::uint32_t>(k);
    }
    return;
  }
  const auto completed = measurements_.push(frame, cycle_);
  if (!completed) return;
  cycle_ = *completed;
  if (!controller_) return;
  answer(*completed, sink);
}

void ControllerNode::answer(std::uint32_t k, FrameSink& sink) noexcept {
  controller_->command(k, measurements_.values(k), u_);
  CanFrame frame;
  for (std::size_t i = 0; i < protectors_.size(); ++i) {
    clamped_values_ += map_->command_messages[i].encode(u_, k, frame);
    protectors_[i].protect(frame);
    sink.send(frame);
  }
}

}  // namespace faultline

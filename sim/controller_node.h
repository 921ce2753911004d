#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "drivers/can/can_bus.h"
#include "drivers/signal/message_integrity.h"
#include "drivers/signal/signal_map.h"
#include "sim/controller.h"
#include "sim/message_assembler.h"
#include "sim/static_feedback.h"

namespace faultline {

/// The controller as a state machine on a bus: answers the measurement of cycle k with the commands
/// of counter k, with the alive counters and checksums that the map asks for. Owns no socket,
/// thread or clock.
class ControllerNode {
 public:
  /// `map` must outlive the node. @param controller nullptr: a real unit answers in its place, and
  /// the node keeps silent.
  ControllerNode(const SignalMap& map, std::unique_ptr<Controller> controller);
  ControllerNode(const SignalMap& map, ControlLaw law);

  /// Takes SYNC and sensor frames; sends commands when a measurement is complete. Real-time: does
  /// not allocate.
  void on_frame(const CanFrame& frame, FrameSink& sink) noexcept;

  /// The newest cycle heard of.
  [[nodiscard]] std::uint32_t cycle() const noexcept { return cycle_; }
  /// Commands that did not fit their signals and were sent clamped.
  [[nodiscard]] std::uint64_t clamped_values() const noexcept { return clamped_values_; }

 private:
  void answer(std::uint32_t k, FrameSink& sink) noexcept;

  const SignalMap* map_;
  std::unique_ptr<Controller> controller_;
  MessageIntegrity sync_integrity_;
  MessageAssembler measurements_;
  std::vector<MessageProtector> protectors_;  // per command message
  std::uint32_t cycle_ = 0;
  std::vector<double> u_;
  std::uint64_t clamped_values_ = 0;
};

}  // namespace faultline

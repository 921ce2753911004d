#pragma once

#include <cstdint>
#include <vector>

#include "drivers/can/can_bus.h"
#include "drivers/signal/signal_map.h"
#include "sim/fault_schedule.h"

namespace faultline {

/// Which node's frames.
enum class BenchNode { kPlant, kController };

/// What the faults of signals and frames do between a node and its bus: takes the node's frames and
/// passes them on, changed, late, several times or not at all. One object per node.
class FrameFaults final : public FrameSink {
 public:
  /// `map` and `schedule` must outlive this.
  FrameFaults(const SignalMap& map, const FaultSchedule& schedule, BenchNode node,
              double sample_time_s);

  /// Frames go to `out` from now on. Call before `begin_cycle`.
  void set_output(FrameSink& out) noexcept { out_ = &out; }
  /// Cycle k begins: sends what was held back for it. Real-time: does not allocate.
  void begin_cycle(std::uint32_t k) noexcept;
  bool send(const CanFrame& frame) noexcept override;
  /// Whether the node hears what is sent to it: not while it is bus-off.
  [[nodiscard]] bool hears() const noexcept { return true; }
  /// Frames of this cycle that were not passed on as they came: who waits for their effect must
  /// not.
  [[nodiscard]] std::uint64_t withheld() const noexcept { return withheld_; }

 private:
  const SignalMap* map_;
  const FaultSchedule* schedule_;
  BenchNode node_;
  double sample_time_s_;
  FrameSink* out_ = nullptr;
  std::uint64_t withheld_ = 0;
};

}  // namespace faultline

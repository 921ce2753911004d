#include "sim/frame_faults.h"

namespace faultline {

FrameFaults::FrameFaults(const SignalMap& map, const FaultSchedule& schedule, BenchNode node,
                         double sample_time_s)
    : map_(&map), schedule_(&schedule), node_(node), sample_time_s_(sample_time_s) {}

void FrameFaults::begin_cycle(std::uint32_t /*k*/) noexcept { withheld_ = 0; }

bool FrameFaults::send(const CanFrame& frame) noexcept { return out_->send(frame); }

}  // namespace faultline

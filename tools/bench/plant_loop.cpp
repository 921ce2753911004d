#include "tools/bench/plant_loop.h"

#include <algorithm>

#include <fmt/format.h>

namespace faultline {
namespace {

using std::chrono::steady_clock;
using Nanoseconds = std::chrono::nanoseconds;

/// A thread that publishes may lose the CPU for so long between the clock and the timeline.
constexpr Nanoseconds kInjectionLead = std::chrono::milliseconds(100);

double in_ms(Nanoseconds time) { return static_cast<double>(time.count()) * 1e-6; }

}  // namespace

PlantLoop::PlantLoop(PlantNode& plant, FrameFaults& faults, CanBus& bus, double sample_time_s,
                     OverrunPolicy overrun, std::size_t most_frames)
    : plant_(plant),
      faults_(faults),
      bus_(bus),
      sample_time_s_(sample_time_s),
      period_(
          std::chrono::duration_cast<Nanoseconds>(std::chrono::duration<double>(sample_time_s))),
      overrun_(overrun),
      frames_(most_frames) {
  cycle_.x = plant.state();
  faults.set_output(frames_);
}

std::optional<StopReason> PlantLoop::run(Time start, std::uint32_t count, PlantLoopHost& host) {
  Time deadline = start;
  for (std::uint32_t k = 0; k < count && !host.must_stop(); ++k, deadline += period_) {
    take_commands_until(deadline, host);
    if (host.must_stop()) break;
    const Nanoseconds late = steady_clock::now() - deadline;
    cycle_.is_overrun = late >= period_;
    if (cycle_.is_overrun && overrun_ == OverrunPolicy::kStop) {
      return StopReason{
          StopReason::Kind::kOverrun,
          fmt::format("cycle {} began {:.3f} ms late, a period is {:.3f} ms (--overrun stop)", k,
                      in_ms(late), in_ms(period_))};
    }
    host.on_begin(k);
    faults_.begin_cycle(k);
    plant_.on_cycle(k, faults_);
    cycle_.is_sent = !cycle_.is_overrun || overrun_ != OverrunPolicy::kSkip;
    if (cycle_.is_sent) {
      bus_.send_batch(frames_.frames());
      cycle_.since_due = steady_clock::now() - deadline;
    }
    frames_.clear();
    cycle_.truth = plant_.truth();
    cycle_.x = plant_.state();
    host.on_cycle(cycle_);
    if (!plant_.is_finite()) {
      return StopReason{StopReason::Kind::kPlant,
                        fmt::format("the plant diverged: at t = {:.6g} s {}", k * sample_time_s_,
                                    plant_.failure())};
    }
  }
  return std::nullopt;
}

std::uint32_t PlantLoop::free_cycle(Time start, Time now) const noexcept {
  // Cycles never begin before their deadline, whatever became of those before.
  const Nanoseconds since = std::max<Nanoseconds>(now - start, Nanoseconds::zero());
  return static_cast<std::uint32_t>((since + kInjectionLead) / period_) + 2;
}

void PlantLoop::take_commands_until(Time deadline, PlantLoopHost& host) {
  for (;;) {
    const auto left = deadline - steady_clock::now();
    if (left <= Nanoseconds::zero() || host.must_stop()) return;
    const ReceiveResult received = bus_.receive(batch_, std::min<Nanoseconds>(left, kIdleWait));
    const std::span<const CanFrame> frames(batch_.data(), received.count);
    if (faults_.hears()) {
      for (const CanFrame& frame : frames) plant_.on_frame(frame);
    }
    host.on_received(received, frames);
  }
}

}  // namespace faultline

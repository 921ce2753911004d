#pragma once

#include <vector>

#include "diagnosis/model/plant_model.h"
#include "drivers/can/can_bus.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// A double integrator with a sensor on each state, an extra fault "leak" on the first state, and
/// an operating point: x₀ = (1, 2), u₀ = 3, y₀ = (1, 2).
[[nodiscard]] PlantModel double_integrator();

/// x' = a x + u + leak + gain·φ(x) + 0.5·wind, y = x + u·0.25 + 2·wind + 3·hum + 4·hiss, about
/// zero; wind is bounded by 0.1, hum by 0.2, hiss not.
[[nodiscard]] PlantModel scalar_plant(double a, double gain, const NonlinearFunction& function);

/// No fault of the plant file: one zero for each.
[[nodiscard]] std::vector<double> no_faults(const PlantModel& plant);

/// SYNC, one sensor message per output and one command message, resolution 2^-10, 8-bit counters.
[[nodiscard]] SignalMap double_integrator_map();

/// Its bus with an alive counter and a checksum in every message: SYNC and Speed by E2E profile 1A,
/// Position by profile 5, the command by J1850.
[[nodiscard]] SignalMap protected_double_integrator_map();

/// Keeps what was sent.
class RecordingSink final : public FrameSink {
 public:
  bool send(const CanFrame& frame) noexcept override {
    frames.push_back(frame);
    return true;
  }
  std::vector<CanFrame> frames;
};

}  // namespace faultline

#pragma once

#include <atomic>
#include <cstdint>
#include <span>

#include "drivers/can/can_bus.h"
#include "drivers/can/error_frame.h"

namespace faultline {

/// A counter that one thread increases at a time and any thread may read.
class RelaxedCounter {
 public:
  void add(std::uint64_t amount = 1) noexcept {
    value_.store(value_.load(std::memory_order_relaxed) + amount, std::memory_order_relaxed);
  }
  [[nodiscard]] std::uint64_t value() const noexcept {
    return value_.load(std::memory_order_relaxed);
  }

 private:
  std::atomic<std::uint64_t> value_{0};
};

/// BusCounters in the making: what a bus increases while others read.
struct AtomicBusCounters {
  RelaxedCounter sent;
  RelaxedCounter send_errors;
  RelaxedCounter received;
  RelaxedCounter dropped;
  RelaxedCounter malformed;
  RelaxedCounter error_frames;
  RelaxedCounter bus_offs;
  RelaxedCounter restarts;
  std::atomic<std::uint64_t> outages{0};  ///< sending and receiving threads both notice them

  /// Counts frames that are about to be returned by `receive`.
  void count_received(std::span<const CanFrame> frames) noexcept {
    received.add(frames.size());
    for (const CanFrame& frame : frames) {
      if (!frame.is_error) continue;
      const ErrorReport report = read_error_frame(frame);
      error_frames.add();
      if (report.state == ControllerState::kBusOff) bus_offs.add();
      if (report.is_restarted) restarts.add();
    }
  }

  [[nodiscard]] BusCounters snapshot() const noexcept {
    return {.sent = sent.value(),
            .send_errors = send_errors.value(),
            .received = received.value(),
            .dropped = dropped.value(),
            .malformed = malformed.value(),
            .error_frames = error_frames.value(),
            .bus_offs = bus_offs.value(),
            .restarts = restarts.value(),
            .outages = outages.load(std::memory_order_relaxed)};
  }
};

}  // namespace faultline

#pragma once

#include <atomic>
#include <cstdint>

#include "drivers/can/can_bus.h"

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

  [[nodiscard]] BusCounters snapshot() const noexcept {
    return {sent.value(), send_errors.value(), received.value(), dropped.value(),
            malformed.value()};
  }
};

}  // namespace faultline

#pragma once

#include <cstddef>
#include <memory>

#include "drivers/can/can_bus.h"

namespace faultline {

/// An in-process bus: deterministic, no sockets. All endpoints see all frames in one order, the
/// order of the calls to `send`. May be used from several threads.
///
/// `send` takes one lock, for the order; `receive` takes none unless it has to wait. Timeouts run
/// on the steady clock, also in virtual time. An endpoint has no `readiness_fd` (-1): poll it with
/// `receive(out, 0)`, or wait in `receive`.
///
/// Frames are stamped with the bus's clock: by default the system's; `set_time` fixes it (virtual
/// time) until the next call.
class LoopBus {
 public:
  /// @param queue_capacity frames each endpoint can hold unread, at least 1; more are dropped, and
  ///   counted by the endpoint that lost them.
  /// @throws std::invalid_argument queue_capacity is 0.
  explicit LoopBus(std::size_t queue_capacity = kDefaultCapacity);
  ~LoopBus();
  LoopBus(const LoopBus&) = delete;
  LoopBus& operator=(const LoopBus&) = delete;

  /// A new endpoint: it receives what is sent from now on, and keeps the bus's state alive.
  /// Allocates its whole queue.
  [[nodiscard]] std::unique_ptr<CanBus> attach();

  /// From now on frames are stamped `now` (virtual time).
  void set_time(Timestamp now) noexcept;

  static constexpr std::size_t kDefaultCapacity = 4096;

 private:
  struct Hub;
  std::shared_ptr<Hub> hub_;
};

}  // namespace faultline

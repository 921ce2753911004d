#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

#include "drivers/can/can_frame.h"

namespace faultline {

/// A bus cannot be opened or set up (no such interface, no CAN in the kernel, no permission).
/// The message names the bus, what failed and what to do.
class BusError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Where a node puts the frames it sends.
class FrameSink {
 public:
  virtual ~FrameSink() = default;
  /// Sends `frame`. @return false if the bus could not take it (counted by the bus as a send
  /// error). Only the payload counts: bytes of `data` beyond `length` reach the others as zero.
  virtual bool send(const CanFrame& frame) noexcept = 0;
};

/// What happened on one endpoint of a bus since it was opened. Counters only grow.
struct BusCounters {
  std::uint64_t sent = 0;         ///< frames handed to the bus
  std::uint64_t send_errors = 0;  ///< frames the bus refused
  std::uint64_t received = 0;     ///< frames returned by `receive`
  std::uint64_t dropped = 0;      ///< frames lost between the bus and this reader (queue full)
  std::uint64_t malformed = 0;    ///< received units that were not a frame
  // Of the frames received:
  std::uint64_t error_frames = 0;  ///< made by the controller (error_frame.h)
  std::uint64_t bus_offs = 0;      ///< of these, that say bus-off
  std::uint64_t restarts = 0;      ///< of these, that say the controller restarted
  std::uint64_t outages = 0;       ///< times the interface went down or away
};

/// The counters of two endpoints together.
[[nodiscard]] inline BusCounters operator+(const BusCounters& a, const BusCounters& b) noexcept {
  return {.sent = a.sent + b.sent,
          .send_errors = a.send_errors + b.send_errors,
          .received = a.received + b.received,
          .dropped = a.dropped + b.dropped,
          .malformed = a.malformed + b.malformed,
          .error_frames = a.error_frames + b.error_frames,
          .bus_offs = a.bus_offs + b.bus_offs,
          .restarts = a.restarts + b.restarts,
          .outages = a.outages + b.outages};
}

enum class ReceiveStatus {
  kOk,       ///< at least one frame was returned
  kTimeout,  ///< nothing arrived in time
  kDown,     ///< the interface went down or away; said once per outage, then kTimeout
  kError,    ///< the system refused; `last_error()` tells
};

struct ReceiveResult {
  ReceiveStatus status = ReceiveStatus::kTimeout;
  std::size_t count = 0;  ///< frames written to the front of the caller's span
};

/// A receive filter: data and remote frames with exactly this identifier pass.
struct IdFilter {
  std::uint32_t id = 0;
  bool is_extended = false;
};

/// One node's endpoint on a bus. A frame sent by one endpoint reaches every other endpoint of the
/// bus, never its own. One thread at a time may call `receive`, one may call `send`.
class CanBus : public FrameSink {
 public:
  /// Waits up to `timeout` (0: not at all) and reads the frames that are there, up to the span's
  /// size, in one batch. Does not allocate.
  virtual ReceiveResult receive(std::span<CanFrame> out,
                                std::chrono::nanoseconds timeout) noexcept = 0;

  /// Sends `frames` in this order, in as few system calls as the bus allows. Does not allocate.
  /// @return how many the bus took; each of the others counts as a send error.
  virtual std::size_t send_batch(std::span<const CanFrame> frames) noexcept {
    std::size_t taken = 0;
    for (const CanFrame& frame : frames) taken += send(frame) ? 1u : 0u;
    return taken;
  }

  /// Lets only frames with these identifiers through from now on; empty: every frame. Error frames
  /// pass whatever the filters, and so do frames that were queued before the call.
  /// @throws BusError if the system refuses.
  virtual void set_filters(std::span<const IdFilter> filters) = 0;

  /// File descriptor that is readable when `receive` would return at once; -1 if the bus has none.
  [[nodiscard]] virtual int readiness_fd() const noexcept = 0;

  /// May be called from any thread.
  [[nodiscard]] virtual BusCounters counters() const noexcept = 0;

  /// False from the moment `receive` or `send` noticed that the interface is down or gone until one
  /// of them noticed that it is back. The bus finds its interface again by itself, as long as
  /// either is called. May be called from any thread.
  [[nodiscard]] virtual bool is_up() const noexcept { return true; }

  /// `errno` of the last refusal by the system, 0 if there was none. May be called from any thread.
  [[nodiscard]] virtual int last_error() const noexcept { return 0; }

  /// How users name this bus: `loop`, `can:vcan0`.
  [[nodiscard]] virtual std::string name() const = 0;
};

}  // namespace faultline

#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "drivers/can/can_bus.h"

namespace faultline {

struct SocketCanOptions {
  /// Bytes asked for with SO_RCVBUFFORCE, or SO_RCVBUF where that is not permitted. The kernel's
  /// default holds 278 frames only (measured). What was granted: `granted_receive_buffer()`.
  int receive_buffer_bytes = 4 << 20;
  bool receive_own = false;  ///< also receive what this endpoint sent
  bool receive_error_frames = true;
};

/// An endpoint on a SocketCAN interface, classic and FD (CAN_RAW).
///
/// Reads with recvmmsg: kernel receive stamps (SO_TIMESTAMPNS) and the drop counter (SO_RXQ_OVFL)
/// come from the same call. The kernel reports drops with the next frame that it does deliver, so
/// `dropped` lags until then. `receive` with a timeout makes two system calls, poll and recvmmsg;
/// without, recvmmsg alone.
///
/// Writes with sendmmsg. Where the interface's queue is full (ENOBUFS) a send waits until nothing
/// has moved for kLongestSendWait; nothing is lost, doubled or reordered by waiting. What is still
/// unsent then counts as send errors, and sends fail at once from then on until one gets through
/// (a controller that is bus-off or alone on its bus takes nothing).
///
/// An outage, the interface down or removed, is survived: `receive` says kDown once (also of an
/// outage that was over before anybody looked, or that `send` noticed), then waits for the
/// interface's return as it waits for frames. When an interface of that name is up again, a new one
/// or the old, filters and error mask are set anew and frames flow. Frames that were queued before
/// the outage are kept. Sends during it fail at once.
class SocketCanBus final : public CanBus {
 public:
  /// Frames read or written in one system call at most.
  static constexpr std::size_t kBatch = 64;
  /// A full queue of a 125 kbit/s bus (10 frames) drains in about 10 ms; five times that is broken.
  static constexpr std::chrono::milliseconds kLongestSendWait{50};

  /// Opens the interface. Allocates every buffer.
  /// @throws BusError no CAN in this kernel, no such interface, no CAN interface, interface down,
  ///   no permission.
  explicit SocketCanBus(const std::string& interface_name, const SocketCanOptions& options = {});
  ~SocketCanBus() override;
  SocketCanBus(const SocketCanBus&) = delete;
  SocketCanBus& operator=(const SocketCanBus&) = delete;

  bool send(const CanFrame& frame) noexcept override;
  std::size_t send_batch(std::span<const CanFrame> frames) noexcept override;
  ReceiveResult receive(std::span<CanFrame> out,
                        std::chrono::nanoseconds timeout) noexcept override;
  void set_filters(std::span<const IdFilter> filters) override;
  [[nodiscard]] int readiness_fd() const noexcept override;
  [[nodiscard]] BusCounters counters() const noexcept override;
  [[nodiscard]] bool is_up() const noexcept override;
  [[nodiscard]] int last_error() const noexcept override;
  [[nodiscard]] std::string name() const override;

  /// Size of the receive buffer in bytes, by the kernel's own count: twice what was asked for, as
  /// it adds its bookkeeping; less if the system limits it (net.core.rmem_max).
  [[nodiscard]] int granted_receive_buffer() const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Opens `interface_name` as the constructor of SocketCanBus does. @throws BusError likewise.
[[nodiscard]] std::unique_ptr<SocketCanBus> open_socketcan(const std::string& interface_name,
                                                           const SocketCanOptions& options = {});

}  // namespace faultline

#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "drivers/can/can_bus.h"

namespace faultline {

struct UdpBusOptions {
  /// Bytes asked for with SO_RCVBUFFORCE, or SO_RCVBUF where that is not permitted. What was
  /// granted: `granted_receive_buffer()`; a classic frame of eight bytes takes about 830 of those,
  /// an FD frame of 64 about 1280, by the kernel's way to count (measured on Linux 6.18).
  int receive_buffer_bytes = 4 << 20;
};

/// An endpoint on a multicast group that carries CAN frames as python-can's `udp_multicast` does
/// (udp_frame.h), so that Python scripts and other processes join without CAN in the kernel.
///
/// It receives what others send, on this host or one hop away (TTL 1), never its own frames: it
/// sends from a socket of its own, and a filter in the kernel keeps what comes from there out of
/// its queue. Stamps are the kernel's, of the arrival. Datagrams that are no frame are counted as
/// malformed. Filters work in this process: a frame that does not pass them is counted nowhere.
///
/// Drops in the receive queue are the kernel's count (SO_RXQ_OVFL), told with the next datagram
/// that is delivered, less the own frames it kept out; where this endpoint sends while others flood
/// it, `dropped` may lag until a frame arrives after the last one it sent. It never counts too
/// many. What is lost on a network between hosts, nobody can count.
///
/// The group is joined on the interface that the route to it names; where there is no route, on
/// `lo` if that carries multicast.
class UdpBus final : public CanBus {
 public:
  /// Frames read or written in one system call at most.
  static constexpr std::size_t kBatch = 64;
  /// A datagram longer than that is no frame (python-can's are 250 bytes long at most, unless their
  /// `channel` is a long name).
  static constexpr std::size_t kLongestDatagram = 1024;
  /// How long a send waits for room in the socket's queue.
  static constexpr std::chrono::milliseconds kLongestSendWait{50};

  /// @param group a multicast address, IPv4 (224.0.0.0/4) or IPv6 (ff00::/8, with `%INTERFACE`
  ///   where its scope is the link). @param port 1 to 65535.
  /// @throws BusError no such address, no interface carries multicast (and what to type), not
  ///   permitted.
  UdpBus(const std::string& group, std::uint16_t port, const UdpBusOptions& options = {});
  ~UdpBus() override;
  UdpBus(const UdpBus&) = delete;
  UdpBus& operator=(const UdpBus&) = delete;

  bool send(const CanFrame& frame) noexcept override;
  std::size_t send_batch(std::span<const CanFrame> frames) noexcept override;
  ReceiveResult receive(std::span<CanFrame> out,
                        std::chrono::nanoseconds timeout) noexcept override;
  void set_filters(std::span<const IdFilter> filters) override;
  [[nodiscard]] int readiness_fd() const noexcept override;
  [[nodiscard]] BusCounters counters() const noexcept override;
  [[nodiscard]] int last_error() const noexcept override;
  /// "udp:239.74.163.2:43113", "udp:[ff15::1]:43113".
  [[nodiscard]] std::string name() const override;

  /// Size of the receive buffer in bytes, by the kernel's own count: twice what was asked for; less
  /// if the system limits it (net.core.rmem_max).
  [[nodiscard]] int granted_receive_buffer() const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline

#include "drivers/can/socketcan_bus.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <mutex>
#include <vector>

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <sys/socket.h>

#include "drivers/can/atomic_bus_counters.h"
#include "drivers/can/bus_socket.h"
#include "drivers/can/can_interface.h"

namespace faultline {
namespace {

/// During an outage the interface is looked for this often: a hundredth of the second that a person
/// takes to plug it in again.
constexpr std::chrono::milliseconds kReturnPoll{10};
/// Longest single wait of `receive`: keeps the deadline's arithmetic far from overflow.
constexpr std::chrono::hours kLongestWait{24};

canid_t wire_id(const CanFrame& frame) noexcept {
  return frame.id | (frame.is_extended ? CAN_EFF_FLAG : 0u) |
         (frame.is_remote ? CAN_RTR_FLAG : 0u) | (frame.is_error ? CAN_ERR_FLAG : 0u);
}

/// Lays `frame` out as the kernel wants it; a classic frame is the front of the FD one.
/// @return bytes to write.
std::size_t to_wire(const CanFrame& frame, canfd_frame& wire) noexcept {
  wire = {};
  wire.can_id = wire_id(frame);
  wire.len = frame.length;
  if (!frame.is_remote) std::memcpy(wire.data, frame.data.data(), frame.length);
  if (!frame.is_fd) return CAN_MTU;
  wire.flags = static_cast<std::uint8_t>((frame.is_bit_rate_switched ? CANFD_BRS : 0) |
                                         (frame.is_error_state ? CANFD_ESI : 0));
  return CANFD_MTU;
}

/// @return false if `size` bytes of `wire` are no frame.
bool from_wire(const canfd_frame& wire, std::size_t size, CanFrame& frame) noexcept {
  const bool is_fd = size == CANFD_MTU;
  if (!is_fd && size != CAN_MTU) return false;
  if (wire.len > (is_fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN)) return false;
  frame = {};
  frame.is_error = (wire.can_id & CAN_ERR_FLAG) != 0;
  frame.is_extended = !frame.is_error && (wire.can_id & CAN_EFF_FLAG) != 0;
  frame.is_remote = !frame.is_error && !is_fd && (wire.can_id & CAN_RTR_FLAG) != 0;
  frame.id = wire.can_id & (frame.is_extended || frame.is_error ? CAN_EFF_MASK : CAN_SFF_MASK);
  frame.length = wire.len;
  frame.is_fd = is_fd;
  frame.is_bit_rate_switched = is_fd && (wire.flags & CANFD_BRS) != 0;
  frame.is_error_state = is_fd && (wire.flags & CANFD_ESI) != 0;
  if (!frame.is_remote) std::memcpy(frame.data.data(), wire.data, wire.len);
  return is_well_formed(frame);
}

/// Whether the system says so when a socket's interface is down or gone.
bool is_outage(int error) noexcept {
  return error == ENETDOWN || error == ENODEV || error == ENXIO;
}

bool set_kernel_filters(const Socket& socket, const std::vector<can_filter>& filters) noexcept {
  return ::setsockopt(socket.fd(), SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(),
                      static_cast<socklen_t>(filters.size() * sizeof(can_filter))) == 0;
}

std::vector<can_filter> kernel_filters(std::span<const IdFilter> filters) {
  std::vector<can_filter> in_kernel;
  for (const IdFilter& filter : filters) {
    const canid_t format = filter.is_extended ? CAN_EFF_FLAG : 0u;
    const canid_t bits = filter.is_extended ? CAN_EFF_MASK : CAN_SFF_MASK;
    in_kernel.push_back({filter.id | format, bits | CAN_EFF_FLAG});
  }
  if (in_kernel.empty()) in_kernel.push_back({0, 0});
  return in_kernel;
}

}  // namespace

struct SocketCanBus::State {
  State(const std::string& interface_name, const SocketCanOptions& options);

  // Receiving thread.
  ReceiveResult read_batch(std::span<CanFrame> out) noexcept;
  /// What `error`, of a read or a wait, means to the caller.
  ReceiveStatus status_of(int error) noexcept;
  /// True once for each outage, or for several between two calls.
  bool take_outage() noexcept;
  void account_drops(std::uint32_t total) noexcept;

  // Sending thread.
  /// Writes the first `count` frames of `outgoing` and counts those that the kernel took.
  /// @return false if no further frame has a chance now.
  bool write_batch(std::size_t count) noexcept;

  // Either thread.
  void begin_outage() noexcept;
  /// Ends the outage if the interface is back. @return whether the bus is up.
  bool try_return() noexcept;
  // Called with set_up_mutex held.
  void discard_error() noexcept;
  bool rebind(int interface_index) noexcept;

  std::string bus_name;
  std::string interface_name;
  Socket socket;
  can_err_mask_t error_mask;
  int granted_receive_buffer = 0;
  AtomicBusCounters counters;
  std::atomic<int> last_error{0};
  std::atomic<bool> is_up{true};
  /// Orders what sets the socket up; on the real-time path it is taken during outages only.
  std::mutex set_up_mutex;
  std::vector<can_filter> filters = kernel_filters({});
  // Used by the receiving thread.
  DatagramBatch<canfd_frame, kBatch> incoming;
  std::array<NoteBuffer, kBatch> notes{};
  std::uint32_t kernel_drops = 0;  ///< the kernel's counter when last told; wraps at 2^32
  std::uint64_t reported_outages = 0;
  // Used by the sending thread.
  DatagramBatch<canfd_frame, kBatch> outgoing;
  bool is_stuck = false;  ///< the queue stayed full for kLongestSendWait
};

SocketCanBus::State::State(const std::string& name, const SocketCanOptions& options)
    : bus_name("can:" + name),
      interface_name(name),
      socket(open_can_socket(bus_name)),
      error_mask(options.receive_error_frames ? CAN_ERR_MASK : 0) {
  const int on = 1;
  const int own = options.receive_own ? 1 : 0;
  set_socket_option(socket, bus_name, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, on, "CAN_RAW_FD_FRAMES");
  set_socket_option(socket, bus_name, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, own,
                    "CAN_RAW_RECV_OWN_MSGS");
  set_socket_option(socket, bus_name, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, error_mask,
                    "CAN_RAW_ERR_FILTER");
  granted_receive_buffer = set_up_receiving(socket, bus_name, options.receive_buffer_bytes);
  if (!bind_to_interface(socket, require_interface(bus_name, interface_name))) {
    throw BusError(bus_name + ": cannot bind: " + errno_text(errno));
  }
}

ReceiveResult SocketCanBus::State::read_batch(std::span<CanFrame> out) noexcept {
  const std::size_t room = std::min(out.size(), kBatch);
  for (std::size_t n = 0; n < room; ++n) {
    incoming.headers[n].msg_hdr.msg_control = notes[n].bytes.data();
    incoming.headers[n].msg_hdr.msg_controllen = kNoteBytes;
  }
  const int received = ::recvmmsg(socket.fd(), incoming.headers.data(), static_cast<unsigned>(room),
                                  MSG_DONTWAIT, nullptr);
  if (received < 0) return {status_of(errno), 0};
  std::size_t count = 0;
  for (std::size_t n = 0; n < static_cast<std::size_t>(received); ++n) {
    const DatagramNotes told = read_notes(incoming.headers[n].msg_hdr);
    if (told.total_drops) account_drops(*told.total_drops);
    if (from_wire(incoming.buffers[n], incoming.headers[n].msg_len, out[count])) {
      out[count++].stamp = told.stamp;
    } else {
      counters.malformed.add();
    }
  }
  if (count == 0) return {};
  counters.count_received(out.first(count));
  return {ReceiveStatus::kOk, count};
}

ReceiveStatus SocketCanBus::State::status_of(int error) noexcept {
  if (error == EAGAIN || error == EWOULDBLOCK || error == EINTR) return ReceiveStatus::kTimeout;
  last_error.store(error, std::memory_order_relaxed);
  if (!is_outage(error)) return ReceiveStatus::kError;
  begin_outage();
  return take_outage() ? ReceiveStatus::kDown : ReceiveStatus::kTimeout;
}

bool SocketCanBus::State::take_outage() noexcept {
  const std::uint64_t outages = counters.outages.load(std::memory_order_acquire);
  if (outages == reported_outages) return false;
  reported_outages = outages;
  return true;
}

void SocketCanBus::State::account_drops(std::uint32_t total) noexcept {
  const std::uint32_t since_last = total - kernel_drops;
  kernel_drops = total;
  counters.dropped.add(since_last);
}

void SocketCanBus::State::begin_outage() noexcept {
  if (is_up.exchange(false)) counters.outages.fetch_add(1, std::memory_order_release);
}

bool SocketCanBus::State::try_return() noexcept {
  const std::lock_guard lock(set_up_mutex);
  if (is_up.load()) return true;
  // The kernel's note of this outage may still lie there, if the other thread noticed it. It is
  // taken away before the look at the interface, so that the note of a next outage is not.
  discard_error();
  const InterfaceState interface = read_interface(interface_name);
  if (!interface.is_can || !interface.is_up) return false;
  if (bound_interface(socket) != interface.index && !rebind(interface.index)) return false;
  is_up.store(true);
  return true;
}

void SocketCanBus::State::discard_error() noexcept {
  int noted = 0;
  socklen_t size = sizeof noted;
  static_cast<void>(::getsockopt(socket.fd(), SOL_SOCKET, SO_ERROR, &noted, &size));
}

bool SocketCanBus::State::rebind(int interface_index) noexcept {
  // Removal of the interface unbound the socket and dropped its filters.
  if (set_kernel_filters(socket, filters) &&
      ::setsockopt(socket.fd(), SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &error_mask, sizeof error_mask) ==
          0) {
    // The removal may have been noted only after the first look; unbound, nothing new is.
    discard_error();
    if (bind_to_interface(socket, interface_index)) return true;
  }
  last_error.store(errno, std::memory_order_relaxed);
  return false;
}

bool SocketCanBus::State::write_batch(std::size_t count) noexcept {
  const auto patience = is_stuck ? std::chrono::milliseconds(0) : kLongestSendWait;
  for (std::size_t next = 0; next < count;) {
    const WriteResult written = write_datagrams(
        socket.fd(), std::span(outgoing.headers).first(count).subspan(next), patience);
    next += written.count;
    counters.sent.add(written.count);
    if (written.count > 0) is_stuck = false;
    if (written.error == 0) break;
    last_error.store(written.error, std::memory_order_relaxed);
    if (is_outage(written.error)) {
      begin_outage();
      return false;
    }
    if (is_queue_full(written.error)) {
      is_stuck = true;
      return false;
    }
    ++next;  // this one is refused; the frames behind it may be good
  }
  return true;
}

SocketCanBus::SocketCanBus(const std::string& interface_name, const SocketCanOptions& options)
    : state_(std::make_unique<State>(interface_name, options)) {}

SocketCanBus::~SocketCanBus() = default;

bool SocketCanBus::send(const CanFrame& frame) noexcept { return send_batch({&frame, 1}) == 1; }

std::size_t SocketCanBus::send_batch(std::span<const CanFrame> frames) noexcept {
  State& state = *state_;
  const std::uint64_t sent_before = state.counters.sent.value();
  bool can_go_on = state.is_up.load(std::memory_order_relaxed) || state.try_return();
  for (std::size_t next = 0; next < frames.size() && can_go_on;) {
    std::size_t filled = 0;
    for (; next < frames.size() && filled < kBatch; ++next) {
      if (!is_well_formed(frames[next])) continue;
      state.outgoing.vectors[filled].iov_len =
          to_wire(frames[next], state.outgoing.buffers[filled]);
      ++filled;
    }
    can_go_on = state.write_batch(filled);
  }
  const std::size_t taken = state.counters.sent.value() - sent_before;
  state.counters.send_errors.add(frames.size() - taken);
  return taken;
}

ReceiveResult SocketCanBus::receive(std::span<CanFrame> out,
                                    std::chrono::nanoseconds timeout) noexcept {
  using std::chrono::steady_clock;
  State& state = *state_;
  if (out.empty()) return {};
  if (state.take_outage()) return {ReceiveStatus::kDown, 0};
  if (state.is_up.load(std::memory_order_relaxed)) {
    if (timeout > std::chrono::nanoseconds::zero()) {
      const int ready = wait_readable(state.socket.fd(), timeout);
      if (ready == 0) return {};
      if (ready < 0) return {state.status_of(errno), 0};
    }
    const ReceiveResult result = state.read_batch(out);
    // The wait may have been for nothing because the sending thread took the kernel's note away.
    if (result.status == ReceiveStatus::kTimeout && state.take_outage()) {
      return {ReceiveStatus::kDown, 0};
    }
    return result;
  }
  // An outage: what was queued before it, then the interface's return.
  const auto deadline =
      steady_clock::now() + std::min<std::chrono::nanoseconds>(timeout, kLongestWait);
  for (;;) {
    state.try_return();
    const ReceiveResult result = state.read_batch(out);
    if (result.status != ReceiveStatus::kTimeout) return result;
    const std::chrono::nanoseconds left = deadline - steady_clock::now();
    if (left <= std::chrono::nanoseconds::zero()) return {};
    const bool is_up = state.is_up.load(std::memory_order_relaxed);
    const int ready = wait_readable(
        state.socket.fd(), is_up ? left : std::min<std::chrono::nanoseconds>(left, kReturnPoll));
    if (ready < 0) return {state.status_of(errno), 0};
  }
}

void SocketCanBus::set_filters(std::span<const IdFilter> filters) {
  State& state = *state_;
  std::vector<can_filter> wanted = kernel_filters(filters);
  const std::lock_guard lock(state.set_up_mutex);
  if (!set_kernel_filters(state.socket, wanted)) {
    throw BusError(state.bus_name + ": cannot set " + std::to_string(filters.size()) +
                   " filters (the kernel takes up to " + std::to_string(CAN_RAW_FILTER_MAX) +
                   "): " + errno_text(errno));
  }
  state.filters = std::move(wanted);
}

int SocketCanBus::readiness_fd() const noexcept { return state_->socket.fd(); }
BusCounters SocketCanBus::counters() const noexcept { return state_->counters.snapshot(); }
bool SocketCanBus::is_up() const noexcept { return state_->is_up.load(std::memory_order_relaxed); }
int SocketCanBus::last_error() const noexcept {
  return state_->last_error.load(std::memory_order_relaxed);
}
std::string SocketCanBus::name() const { return state_->bus_name; }
int SocketCanBus::granted_receive_buffer() const noexcept { return state_->granted_receive_buffer; }

std::unique_ptr<SocketCanBus> open_socketcan(const std::string& interface_name,
                                             const SocketCanOptions& options) {
  return std::make_unique<SocketCanBus>(interface_name, options);
}

}  // namespace faultline

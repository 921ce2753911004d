#include "drivers/can/socketcan_bus.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <poll.h>
#include <unistd.h>

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "drivers/can/atomic_bus_counters.h"

namespace faultline {
namespace {

/// Between two tries to send into a full queue: about one classic frame at 500 kbit/s.
constexpr std::chrono::microseconds kSendRetryPause{200};

/// Room for what the kernel tells with each frame: SO_TIMESTAMPNS and SO_RXQ_OVFL.
constexpr std::size_t kControlBytes =
    CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t));

std::string reason(int error) { return std::generic_category().message(error); }

/// A file descriptor that closes itself.
class Socket {
 public:
  explicit Socket(int fd) noexcept : fd_(fd) {}
  ~Socket() { ::close(fd_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  [[nodiscard]] int fd() const noexcept { return fd_; }

 private:
  int fd_;
};

int open_can_socket(const std::string& bus) {
  const int fd = ::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW);
  if (fd >= 0) return fd;
  const int error = errno;
  switch (error) {
    case EAFNOSUPPORT:
    case EPROTONOSUPPORT:
    case ESOCKTNOSUPPORT:
      throw BusError(bus + ": this kernel has no CAN sockets (" + reason(error) +
                     "): run it inside tools/with-vcan, or load the module can_raw");
    case EPERM:
    case EACCES:
      throw BusError(bus + ": not permitted to open a CAN socket (" + reason(error) +
                     "): run it as a user, or in a container, that may");
    default:
      throw BusError(bus + ": cannot open a CAN socket: " + reason(error));
  }
}

template <class T>
void set_option(const Socket& socket, const std::string& bus, int level, int option, const T& value,
                const char* option_name) {
  if (::setsockopt(socket.fd(), level, option, &value, sizeof value) != 0) {
    throw BusError(bus + ": cannot set " + option_name + ": " + reason(errno));
  }
}

ifreq request_for(const std::string& interface_name) noexcept {
  ifreq request{};
  interface_name.copy(request.ifr_name, IFNAMSIZ - 1);
  return request;
}

bool is_can_interface(const Socket& socket, const std::string& interface_name) noexcept {
  ifreq request = request_for(interface_name);
  return ::ioctl(socket.fd(), SIOCGIFHWADDR, &request) == 0 &&
         request.ifr_hwaddr.sa_family == ARPHRD_CAN;
}

/// "vcan0, vcan1", or a sentence how to make one.
std::string list_can_interfaces(const Socket& socket) {
  std::string names;
  struct if_nameindex* const interfaces = ::if_nameindex();
  for (const struct if_nameindex* entry = interfaces; entry != nullptr && entry->if_index != 0;
       ++entry) {
    if (!is_can_interface(socket, entry->if_name)) continue;
    if (!names.empty()) names += ", ";
    names += entry->if_name;
  }
  if (interfaces != nullptr) ::if_freenameindex(interfaces);
  if (names.empty()) {
    return "there is no CAN interface at all (make a virtual one: ip link add dev vcan0 type vcan)";
  }
  return "CAN interfaces here: " + names;
}

/// @return the interface's index. @throws BusError it is no CAN interface that is up.
int find_interface(const Socket& socket, const std::string& bus,
                   const std::string& interface_name) {
  if (interface_name.empty() || interface_name.size() >= IFNAMSIZ) {
    throw BusError(bus + ": interface name of " + std::to_string(interface_name.size()) +
                   " characters, expected 1 to " + std::to_string(IFNAMSIZ - 1));
  }
  ifreq request = request_for(interface_name);
  if (::ioctl(socket.fd(), SIOCGIFINDEX, &request) != 0) {
    throw BusError(bus + ": no such interface; " + list_can_interfaces(socket));
  }
  const int index = request.ifr_ifindex;
  if (!is_can_interface(socket, interface_name)) {
    throw BusError(bus + ": not a CAN interface; " + list_can_interfaces(socket));
  }
  request = request_for(interface_name);
  if (::ioctl(socket.fd(), SIOCGIFFLAGS, &request) != 0) {
    throw BusError(bus + ": cannot read the interface's state: " + reason(errno));
  }
  if ((request.ifr_flags & IFF_UP) == 0) {
    throw BusError(bus + ": the interface is down: ip link set " + interface_name + " up");
  }
  return index;
}

void bind_to_interface(const Socket& socket, const std::string& bus,
                       const std::string& interface_name) {
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = find_interface(socket, bus, interface_name);
  if (::bind(socket.fd(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    throw BusError(bus + ": cannot bind: " + reason(errno));
  }
}

/// @return the size granted, by the kernel's own count.
int size_receive_buffer(const Socket& socket, const std::string& bus, int bytes) {
  if (::setsockopt(socket.fd(), SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof bytes) != 0) {
    set_option(socket, bus, SOL_SOCKET, SO_RCVBUF, bytes, "SO_RCVBUF");
  }
  int granted = 0;
  socklen_t size = sizeof granted;
  if (::getsockopt(socket.fd(), SOL_SOCKET, SO_RCVBUF, &granted, &size) != 0) {
    throw BusError(bus + ": cannot read SO_RCVBUF: " + reason(errno));
  }
  return granted;
}

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
  frame.is_extended = (wire.can_id & CAN_EFF_FLAG) != 0;
  frame.is_error = (wire.can_id & CAN_ERR_FLAG) != 0;
  frame.is_remote = !frame.is_error && (wire.can_id & CAN_RTR_FLAG) != 0;
  frame.id = wire.can_id & (frame.is_extended || frame.is_error ? CAN_EFF_MASK : CAN_SFF_MASK);
  frame.length = wire.len;
  frame.is_fd = is_fd;
  frame.is_bit_rate_switched = is_fd && (wire.flags & CANFD_BRS) != 0;
  frame.is_error_state = is_fd && (wire.flags & CANFD_ESI) != 0;
  if (!frame.is_remote) std::memcpy(frame.data.data(), wire.data, wire.len);
  return true;
}

/// What the kernel told about one received frame besides the frame.
struct FrameNotes {
  Timestamp stamp{};
  std::optional<std::uint32_t> total_drops;
};

FrameNotes read_notes(msghdr& message) noexcept {
  FrameNotes notes;
  for (cmsghdr* note = CMSG_FIRSTHDR(&message); note != nullptr;
       note = CMSG_NXTHDR(&message, note)) {
    if (note->cmsg_level != SOL_SOCKET) continue;
    if (note->cmsg_type == SCM_TIMESTAMPNS) {
      timespec time{};
      std::memcpy(&time, CMSG_DATA(note), sizeof time);
      notes.stamp =
          Timestamp(std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec));
    } else if (note->cmsg_type == SO_RXQ_OVFL) {
      std::uint32_t drops = 0;
      std::memcpy(&drops, CMSG_DATA(note), sizeof drops);
      notes.total_drops = drops;
    }
  }
  return notes;
}

/// What one batch of system calls reads or writes: kBatch frames and their headers, wired up once.
struct Batch {
  Batch() noexcept {
    for (std::size_t n = 0; n < SocketCanBus::kBatch; ++n) {
      vectors[n] = {&frames[n], sizeof frames[n]};
      headers[n].msg_hdr.msg_iov = &vectors[n];
      headers[n].msg_hdr.msg_iovlen = 1;
    }
  }
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  std::array<canfd_frame, SocketCanBus::kBatch> frames{};
  std::array<iovec, SocketCanBus::kBatch> vectors{};
  std::array<mmsghdr, SocketCanBus::kBatch> headers{};
};

struct ControlBuffer {
  alignas(cmsghdr) std::array<std::byte, kControlBytes> bytes;
};

bool is_queue_full(int error) noexcept {
  return error == ENOBUFS || error == EAGAIN || error == EWOULDBLOCK;
}

}  // namespace

struct SocketCanBus::State {
  State(const std::string& interface_name, const SocketCanOptions& options);

  /// Readable now or within `timeout`? @return 1 yes, 0 no, -1 error in errno.
  [[nodiscard]] int wait_readable(std::chrono::nanoseconds timeout) const noexcept;
  ReceiveResult read_batch(std::span<CanFrame> out) noexcept;
  ReceiveResult report(int error) noexcept;
  void account_drops(std::uint32_t total) noexcept;
  /// Writes the first `count` frames of `outgoing` and counts those that the kernel took.
  /// @return false if its queue stayed full.
  bool write_batch(std::size_t count) noexcept;

  std::string bus_name;
  Socket socket;
  int granted_receive_buffer = 0;
  AtomicBusCounters counters;
  std::atomic<int> last_error{0};
  // Used by the receiving thread.
  Batch incoming;
  std::array<ControlBuffer, kBatch> notes{};
  std::uint32_t kernel_drops = 0;  ///< the kernel's counter when last told; wraps at 2^32
  bool is_gone = false;
  // Used by the sending thread.
  Batch outgoing;
};

SocketCanBus::State::State(const std::string& interface_name, const SocketCanOptions& options)
    : bus_name("can:" + interface_name), socket(open_can_socket(bus_name)) {
  const int on = 1;
  const int own = options.receive_own ? 1 : 0;
  const can_err_mask_t errors = options.receive_error_frames ? CAN_ERR_MASK : 0;
  set_option(socket, bus_name, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, on, "CAN_RAW_FD_FRAMES");
  set_option(socket, bus_name, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, own, "CAN_RAW_RECV_OWN_MSGS");
  set_option(socket, bus_name, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, errors, "CAN_RAW_ERR_FILTER");
  set_option(socket, bus_name, SOL_SOCKET, SO_TIMESTAMPNS, on, "SO_TIMESTAMPNS");
  set_option(socket, bus_name, SOL_SOCKET, SO_RXQ_OVFL, on, "SO_RXQ_OVFL");
  granted_receive_buffer = size_receive_buffer(socket, bus_name, options.receive_buffer_bytes);
  bind_to_interface(socket, bus_name, interface_name);
}

int SocketCanBus::State::wait_readable(std::chrono::nanoseconds timeout) const noexcept {
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(timeout);
  const timespec limit{static_cast<std::time_t>(seconds.count()),
                       static_cast<long>((timeout - seconds).count())};
  pollfd readiness{socket.fd(), POLLIN, 0};
  return ::ppoll(&readiness, 1, &limit, nullptr);
}

ReceiveResult SocketCanBus::State::read_batch(std::span<CanFrame> out) noexcept {
  const std::size_t room = std::min(out.size(), kBatch);
  for (std::size_t n = 0; n < room; ++n) {
    incoming.headers[n].msg_hdr.msg_control = notes[n].bytes.data();
    incoming.headers[n].msg_hdr.msg_controllen = kControlBytes;
  }
  const int received = ::recvmmsg(socket.fd(), incoming.headers.data(), static_cast<unsigned>(room),
                                  MSG_DONTWAIT, nullptr);
  if (received < 0) return report(errno);
  std::size_t count = 0;
  for (std::size_t n = 0; n < static_cast<std::size_t>(received); ++n) {
    const FrameNotes told = read_notes(incoming.headers[n].msg_hdr);
    if (told.total_drops) account_drops(*told.total_drops);
    if (from_wire(incoming.frames[n], incoming.headers[n].msg_len, out[count])) {
      out[count++].stamp = told.stamp;
    } else {
      counters.malformed.add();
    }
  }
  if (count == 0) return {};
  counters.received.add(count);
  return {ReceiveStatus::kOk, count};
}

ReceiveResult SocketCanBus::State::report(int error) noexcept {
  if (error == EAGAIN || error == EWOULDBLOCK || error == EINTR) return {};
  last_error.store(error, std::memory_order_relaxed);
  if (error == ENODEV || error == ENXIO) is_gone = true;
  const bool is_down = is_gone || error == ENETDOWN;
  return {is_down ? ReceiveStatus::kDown : ReceiveStatus::kError, 0};
}

void SocketCanBus::State::account_drops(std::uint32_t total) noexcept {
  const std::uint32_t since_last = total - kernel_drops;
  kernel_drops = total;
  counters.dropped.add(since_last);
}

bool SocketCanBus::State::write_batch(std::size_t count) noexcept {
  std::optional<std::chrono::steady_clock::time_point> give_up;
  for (std::size_t next = 0; next < count;) {
    const int written = ::sendmmsg(socket.fd(), outgoing.headers.data() + next,
                                   static_cast<unsigned>(count - next), MSG_DONTWAIT);
    if (written > 0) {
      next += static_cast<std::size_t>(written);
      counters.sent.add(static_cast<std::uint64_t>(written));
      give_up.reset();
      continue;
    }
    const int error = errno;
    if (error == EINTR) continue;
    if (!is_queue_full(error)) {
      last_error.store(error, std::memory_order_relaxed);
      ++next;  // this one is refused; the frames behind it may be good
      continue;
    }
    const auto now = std::chrono::steady_clock::now();
    if (!give_up) give_up = now + kLongestSendWait;
    if (now >= *give_up) {
      last_error.store(error, std::memory_order_relaxed);
      return false;
    }
    std::this_thread::sleep_for(kSendRetryPause);
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
  bool has_room = true;
  for (std::size_t next = 0; next < frames.size() && has_room;) {
    std::size_t filled = 0;
    for (; next < frames.size() && filled < kBatch; ++next) {
      if (!is_well_formed(frames[next])) continue;
      state.outgoing.vectors[filled].iov_len = to_wire(frames[next], state.outgoing.frames[filled]);
      ++filled;
    }
    has_room = state.write_batch(filled);
  }
  const std::size_t taken = state.counters.sent.value() - sent_before;
  state.counters.send_errors.add(frames.size() - taken);
  return taken;
}

ReceiveResult SocketCanBus::receive(std::span<CanFrame> out,
                                    std::chrono::nanoseconds timeout) noexcept {
  State& state = *state_;
  if (out.empty()) return {};
  if (state.is_gone) return {ReceiveStatus::kDown, 0};
  if (timeout > std::chrono::nanoseconds::zero()) {
    const int ready = state.wait_readable(timeout);
    if (ready == 0) return {};
    if (ready < 0) return state.report(errno);
  }
  return state.read_batch(out);
}

void SocketCanBus::set_filters(std::span<const IdFilter> filters) {
  std::vector<can_filter> kernel_filters;
  for (const IdFilter& filter : filters) {
    const canid_t format = filter.is_extended ? CAN_EFF_FLAG : 0u;
    const canid_t bits = filter.is_extended ? CAN_EFF_MASK : CAN_SFF_MASK;
    kernel_filters.push_back({filter.id | format, bits | CAN_EFF_FLAG});
  }
  if (kernel_filters.empty()) kernel_filters.push_back({0, 0});
  if (::setsockopt(state_->socket.fd(), SOL_CAN_RAW, CAN_RAW_FILTER, kernel_filters.data(),
                   static_cast<socklen_t>(kernel_filters.size() * sizeof(can_filter))) != 0) {
    throw BusError(state_->bus_name + ": cannot set " + std::to_string(filters.size()) +
                   " filters (the kernel takes up to " + std::to_string(CAN_RAW_FILTER_MAX) +
                   "): " + reason(errno));
  }
}

int SocketCanBus::readiness_fd() const noexcept { return state_->socket.fd(); }
BusCounters SocketCanBus::counters() const noexcept { return state_->counters.snapshot(); }
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

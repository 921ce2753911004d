#include "drivers/can/udp_bus.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <mutex>
#include <vector>

#include <sys/socket.h>

#include "drivers/can/atomic_bus_counters.h"
#include "drivers/can/bus_socket.h"
#include "drivers/can/id_filters.h"
#include "drivers/can/multicast_group.h"
#include "drivers/can/udp_frame.h"

namespace faultline {
namespace {

/// Longest single wait of `receive`: keeps the deadline's arithmetic far from overflow.
constexpr std::chrono::hours kLongestWait{24};
/// So many batches of which no frame passes the filters may hold `receive` up at most.
constexpr int kMostBatches = 16;

using Datagram = std::array<std::uint8_t, UdpBus::kLongestDatagram>;
using OutgoingDatagram = std::array<std::uint8_t, kLongestUdpFrame>;

std::string bus_name(const std::string& group, std::uint16_t port) {
  const bool is_v6 = group.find(':') != std::string::npos;
  return "udp:" + (is_v6 ? "[" + group + "]" : group) + ":" + std::to_string(port);
}

MulticastAddress require_address(const std::string& group, std::uint16_t port) {
  const auto address = parse_multicast_address(group, port);
  if (!address || port == 0) {
    throw BusError(bus_name(group, port) +
                   ": expected the number of a multicast group (224.0.0.0/4 or ff00::/8) and a "
                   "port from 1 to 65535");
  }
  return *address;
}

}  // namespace

struct UdpBus::State {
  State(const std::string& group, std::uint16_t port, const UdpBusOptions& options);

  // Receiving thread.
  /// Reads datagrams that are there. @return kOk also where none was a frame that passes.
  ReceiveResult read_batch(std::span<CanFrame> out) noexcept;
  void account_drops(std::uint32_t total) noexcept;
  // Sending thread.
  bool write_batch(std::size_t count) noexcept;

  std::string name;
  MulticastSockets sockets;
  int granted_receive_buffer = 0;
  AtomicBusCounters counters;
  std::atomic<int> last_error{0};
  std::mutex filter_mutex;  ///< free but while filters are set
  IdFilters filters;
  // Used by the receiving thread.
  DatagramBatch<Datagram, kBatch> incoming;
  std::array<NoteBuffer, kBatch> notes{};
  std::uint32_t kernel_drops = 0;      ///< the kernel's counter when last told; wraps at 2^32
  std::uint64_t kept_out_or_lost = 0;  ///< the same, without the wrapping
  // Used by the sending thread.
  DatagramBatch<OutgoingDatagram, kBatch> outgoing;
  /// Handed to the kernel and not refused; counted before they can reach the filter.
  std::atomic<std::uint64_t> own_datagrams{0};
};

UdpBus::State::State(const std::string& group, std::uint16_t port, const UdpBusOptions& options)
    : name(bus_name(group, port)), sockets(join_group(require_address(group, port), name)) {
  granted_receive_buffer = set_up_receiving(sockets.receiving, name, options.receive_buffer_bytes);
}

ReceiveResult UdpBus::State::read_batch(std::span<CanFrame> out) noexcept {
  const std::size_t room = std::min(out.size(), kBatch);
  for (std::size_t n = 0; n < room; ++n) {
    incoming.headers[n].msg_hdr.msg_control = notes[n].bytes.data();
    incoming.headers[n].msg_hdr.msg_controllen = kNoteBytes;
  }
  const int received = ::recvmmsg(sockets.receiving.fd(), incoming.headers.data(),
                                  static_cast<unsigned>(room), MSG_DONTWAIT, nullptr);
  if (received < 0) {
    const int error = errno;
    if (error == EAGAIN || error == EWOULDBLOCK || error == EINTR) return {};
    last_error.store(error, std::memory_order_relaxed);
    return {ReceiveStatus::kError, 0};
  }
  std::size_t count = 0;
  const std::lock_guard lock(filter_mutex);
  for (std::size_t n = 0; n < static_cast<std::size_t>(received); ++n) {
    msghdr& header = incoming.headers[n].msg_hdr;
    const DatagramNotes told = read_notes(header);
    if (told.total_drops) account_drops(*told.total_drops);
    CanFrame& frame = out[count];
    const bool is_whole = (header.msg_flags & MSG_TRUNC) == 0;
    if (!is_whole ||
        !decode_udp_frame({incoming.buffers[n].data(), incoming.headers[n].msg_len}, frame)) {
      counters.malformed.add();
      continue;
    }
    frame.stamp = told.stamp;
    if (filters.pass(frame)) ++count;
  }
  counters.count_received(out.first(count));
  return {ReceiveStatus::kOk, count};
}

void UdpBus::State::account_drops(std::uint32_t total) noexcept {
  kept_out_or_lost += total - kernel_drops;
  kernel_drops = total;
  // Of its own datagrams some may not yet have been in this count: what is left then is too small,
  // never too large, and the largest of all estimates is right in the end.
  const std::uint64_t own = own_datagrams.load();
  const std::uint64_t counted = counters.dropped.value();
  if (kept_out_or_lost > own + counted) counters.dropped.add(kept_out_or_lost - own - counted);
}

bool UdpBus::State::write_batch(std::size_t count) noexcept {
  own_datagrams.fetch_add(count);
  std::size_t taken = 0;
  bool has_room = true;
  for (std::size_t next = 0; next < count && has_room;) {
    const WriteResult written =
        write_datagrams(sockets.sending.fd(),
                        std::span(outgoing.headers).first(count).subspan(next), kLongestSendWait);
    taken += written.count;
    next += written.count;
    if (written.error == 0) break;
    last_error.store(written.error, std::memory_order_relaxed);
    has_room = !is_queue_full(written.error);
    ++next;  // this one is refused; the frames behind it may be good
  }
  own_datagrams.fetch_sub(count - taken);
  counters.sent.add(taken);
  return has_room;
}

UdpBus::UdpBus(const std::string& group, std::uint16_t port, const UdpBusOptions& options)
    : state_(std::make_unique<State>(group, port, options)) {}

UdpBus::~UdpBus() = default;

bool UdpBus::send(const CanFrame& frame) noexcept { return send_batch({&frame, 1}) == 1; }

std::size_t UdpBus::send_batch(std::span<const CanFrame> frames) noexcept {
  State& state = *state_;
  const std::uint64_t sent_before = state.counters.sent.value();
  const Timestamp now = std::chrono::system_clock::now();
  bool has_room = true;
  for (std::size_t next = 0; next < frames.size() && has_room;) {
    std::size_t filled = 0;
    for (; next < frames.size() && filled < kBatch; ++next) {
      CanFrame frame = frames[next];
      frame.stamp = now;
      const std::size_t size = encode_udp_frame(frame, state.outgoing.buffers[filled]);
      if (size == 0) continue;
      state.outgoing.vectors[filled].iov_len = size;
      ++filled;
    }
    has_room = state.write_batch(filled);
  }
  const std::size_t taken = state.counters.sent.value() - sent_before;
  state.counters.send_errors.add(frames.size() - taken);
  return taken;
}

ReceiveResult UdpBus::receive(std::span<CanFrame> out, std::chrono::nanoseconds timeout) noexcept {
  using std::chrono::steady_clock;
  State& state = *state_;
  if (out.empty()) return {};
  const bool may_wait = timeout > std::chrono::nanoseconds::zero();
  std::chrono::nanoseconds left = std::min<std::chrono::nanoseconds>(timeout, kLongestWait);
  steady_clock::time_point deadline{};
  if (may_wait) deadline = steady_clock::now() + left;
  for (int batches = 0; batches < kMostBatches; ++batches) {
    if (may_wait && wait_readable(state.sockets.receiving.fd(), left) == 0) return {};
    const ReceiveResult result = state.read_batch(out);
    if (result.status != ReceiveStatus::kOk || result.count > 0) return result;
    // Nothing of the batch passed the filters.
    if (!may_wait) continue;
    left = deadline - steady_clock::now();
    if (left <= std::chrono::nanoseconds::zero()) return {};
  }
  return {};
}

void UdpBus::set_filters(std::span<const IdFilter> filters) {
  IdFilters wanted(filters);
  const std::lock_guard lock(state_->filter_mutex);
  state_->filters = std::move(wanted);
}

int UdpBus::readiness_fd() const noexcept { return state_->sockets.receiving.fd(); }
BusCounters UdpBus::counters() const noexcept { return state_->counters.snapshot(); }
int UdpBus::last_error() const noexcept {
  return state_->last_error.load(std::memory_order_relaxed);
}
std::string UdpBus::name() const { return state_->name; }
int UdpBus::granted_receive_buffer() const noexcept { return state_->granted_receive_buffer; }

}  // namespace faultline

#pragma once

#include <array>
#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include <sys/socket.h>

#include "drivers/can/can_frame.h"

namespace faultline {

// What the buses that live on kernel sockets share: stamps, drop counts, batches, waiting.

/// A file descriptor that closes itself.
class Socket {
 public:
  /// @param fd an open descriptor, which becomes this object's, or -1.
  explicit Socket(int fd) noexcept : fd_(fd) {}
  ~Socket();
  Socket(Socket&& other) noexcept;
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  [[nodiscard]] int fd() const noexcept { return fd_; }

 private:
  int fd_;
};

/// The system's words for `error`.
[[nodiscard]] std::string errno_text(int error);

/// @throws BusError "`bus`: cannot set `option_name`: ...".
void set_socket_option(const Socket& socket, const std::string& bus, int level, int option,
                       const void* value, std::size_t size, const char* option_name);
template <class T>
void set_socket_option(const Socket& socket, const std::string& bus, int level, int option,
                       const T& value, const char* option_name) {
  set_socket_option(socket, bus, level, option, &value, sizeof value, option_name);
}

/// Asks for kernel receive stamps (SO_TIMESTAMPNS) and the drop counter (SO_RXQ_OVFL), and for a
/// receive buffer of `buffer_bytes`, beyond net.core.rmem_max where that is permitted.
/// @return the size granted, by the kernel's own count. @throws BusError.
int set_up_receiving(const Socket& socket, const std::string& bus, int buffer_bytes);

/// Room for what the kernel tells with each datagram: stamp and drop counter.
inline constexpr std::size_t kNoteBytes =
    CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t));

struct DatagramNotes {
  Timestamp stamp{};
  std::optional<std::uint32_t> total_drops;  ///< since the socket was opened; wraps at 2^32
};

/// Reads what came with a datagram besides its bytes.
[[nodiscard]] DatagramNotes read_notes(msghdr& message) noexcept;

/// What one system call reads or writes: `count` buffers and their headers, wired up once.
template <class Buffer, std::size_t count>
struct DatagramBatch {
  DatagramBatch() noexcept {
    for (std::size_t n = 0; n < count; ++n) {
      vectors[n] = {&buffers[n], sizeof buffers[n]};
      headers[n].msg_hdr.msg_iov = &vectors[n];
      headers[n].msg_hdr.msg_iovlen = 1;
    }
  }
  DatagramBatch(const DatagramBatch&) = delete;
  DatagramBatch& operator=(const DatagramBatch&) = delete;

  std::array<Buffer, count> buffers{};
  std::array<iovec, count> vectors{};
  std::array<mmsghdr, count> headers{};
};

struct alignas(cmsghdr) NoteBuffer {
  std::array<std::byte, kNoteBytes> bytes;
};

/// Waits up to `timeout` for something to read or an error. @return 1 yes, 0 no, -1 error in errno.
[[nodiscard]] int wait_readable(int fd, std::chrono::nanoseconds timeout) noexcept;

/// Between two tries to send into a full queue: about one classic frame at 500 kbit/s.
inline constexpr std::chrono::microseconds kSendRetryPause{200};

[[nodiscard]] inline bool is_queue_full(int error) noexcept {
  return error == ENOBUFS || error == EAGAIN || error == EWOULDBLOCK;
}

struct WriteResult {
  std::size_t count = 0;  ///< datagrams written, from the first on
  int error = 0;          ///< errno of the one behind them; 0: all are written
};

/// Writes `datagrams` in this order, none twice. Where the queue is full it tries again until
/// nothing has moved for `patience`: poll is no help, because the queue of an interface (ENOBUFS)
/// wakes nobody.
[[nodiscard]] WriteResult write_datagrams(int fd, std::span<mmsghdr> datagrams,
                                          std::chrono::nanoseconds patience) noexcept;

}  // namespace faultline

#include "drivers/can/bus_socket.h"

#include <cstring>
#include <ctime>
#include <system_error>
#include <thread>
#include <utility>

#include <poll.h>
#include <unistd.h>

#include "drivers/can/can_bus.h"

namespace faultline {

Socket::~Socket() {
  if (fd_ >= 0) ::close(fd_);
}

Socket::Socket(Socket&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

std::string errno_text(int error) { return std::generic_category().message(error); }

void set_socket_option(const Socket& socket, const std::string& bus, int level, int option,
                       const void* value, std::size_t size, const char* option_name) {
  if (::setsockopt(socket.fd(), level, option, value, static_cast<socklen_t>(size)) != 0) {
    throw BusError(bus + ": cannot set " + option_name + ": " + errno_text(errno));
  }
}

int set_up_receiving(const Socket& socket, const std::string& bus, int buffer_bytes) {
  const int on = 1;
  set_socket_option(socket, bus, SOL_SOCKET, SO_TIMESTAMPNS, on, "SO_TIMESTAMPNS");
  set_socket_option(socket, bus, SOL_SOCKET, SO_RXQ_OVFL, on, "SO_RXQ_OVFL");
  if (::setsockopt(socket.fd(), SOL_SOCKET, SO_RCVBUFFORCE, &buffer_bytes, sizeof buffer_bytes) !=
      0) {
    set_socket_option(socket, bus, SOL_SOCKET, SO_RCVBUF, buffer_bytes, "SO_RCVBUF");
  }
  int granted = 0;
  socklen_t size = sizeof granted;
  if (::getsockopt(socket.fd(), SOL_SOCKET, SO_RCVBUF, &granted, &size) != 0) {
    throw BusError(bus + ": cannot read SO_RCVBUF: " + errno_text(errno));
  }
  return granted;
}

DatagramNotes read_notes(msghdr& message) noexcept {
  DatagramNotes notes;
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

int wait_readable(int fd, std::chrono::nanoseconds timeout) noexcept {
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(timeout);
  const timespec limit{static_cast<std::time_t>(seconds.count()),
                       static_cast<long>((timeout - seconds).count())};
  pollfd readiness{fd, POLLIN, 0};
  return ::ppoll(&readiness, 1, &limit, nullptr);
}

WriteResult write_datagrams(int fd, std::span<mmsghdr> datagrams,
                            std::chrono::nanoseconds patience) noexcept {
  std::optional<std::chrono::steady_clock::time_point> give_up;
  for (std::size_t next = 0; next < datagrams.size();) {
    const int written = ::sendmmsg(fd, datagrams.data() + next,
                                   static_cast<unsigned>(datagrams.size() - next), MSG_DONTWAIT);
    if (written > 0) {
      next += static_cast<std::size_t>(written);
      give_up.reset();
      continue;
    }
    const int error = errno;
    if (error == EINTR) continue;
    if (!is_queue_full(error)) return {next, error};
    const auto now = std::chrono::steady_clock::now();
    if (!give_up) give_up = now + patience;
    if (now >= *give_up) return {next, error};
    std::this_thread::sleep_for(kSendRetryPause);
  }
  return {datagrams.size(), 0};
}

}  // namespace faultline

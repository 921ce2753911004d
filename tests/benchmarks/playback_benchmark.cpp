// Playback timing: a log of 1 kHz played by `faultline play`, by lcm-logplayer, and sent by a bare
// timer (clock_nanosleep, TIMER_ABSTIME, then sendto; also with the priority that
// `faultline play` takes where it may), in turns, several rounds. A receiver takes
// the kernel's receive times. Of each: error = arrival - time in the log, its median removed; p50
// and p99 of |error|; drift = mean error of the last second less that of the first.
//
//   unshare -n sh -c 'ip link set lo up multicast on; ip route add 224.0.0.0/4 dev lo;
//                     build/release/bin/playback_benchmark [SECONDS [ROUNDS]]'
#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <system_error>
#include <vector>

#include <sched.h>
#include <time.h>
#include <unistd.h>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include "tools/lcm/message_sink.h"

namespace faultline {
namespace {

constexpr char kGroup[] = "239.255.76.67";
constexpr std::uint16_t kPort = 7667;
constexpr char kUrl[] = "udpm://239.255.76.67:7667?ttl=0";
constexpr char kChannel[] = "PLAYBACK";
constexpr std::size_t kPayload = 206;  // bytes, as a SAMPLE and a RESIDUAL of Hou's bench
constexpr std::int64_t kPeriod_us = 1000;
constexpr std::int64_t kBegin_us = 1'700'000'000'000'000;
constexpr int kPriority = 60;  // that of faultline play
constexpr std::int64_t kCyclesPerSecond = 1'000'000 / kPeriod_us;
/// LCM's header of a datagram: magic, sequence number; then the channel with its NUL.
constexpr std::size_t kHeaderBytes = 8;
constexpr std::size_t kPrefix = kHeaderBytes + sizeof kChannel;

int check(int result, const char* what) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), what);
  return result;
}

std::vector<std::uint8_t> payload(std::int64_t index) {
  std::vector<std::uint8_t> bytes(kPayload);
  std::memcpy(bytes.data(), &index, sizeof index);
  return bytes;
}

void write_log(const std::filesystem::path& file, std::int64_t count) {
  const auto log = open_log(file);
  for (std::int64_t i = 0; i < count; ++i) {
    log->publish(kChannel, kBegin_us + i * kPeriod_us, payload(i));
  }
  log->close();
}

sockaddr_in group_address() {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(kPort);
  ::inet_pton(AF_INET, kGroup, &address.sin_addr);
  return address;
}

class Receiver {
 public:
  Receiver() : fd_(check(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0), "socket")) {
    const int on = 1, buffer = 8 << 20;
    const timeval patience{.tv_sec = 2, .tv_usec = 0};
    check(::setsockopt(fd_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on), "SO_REUSEADDR");
    check(::setsockopt(fd_, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on), "SO_TIMESTAMPNS");
    check(::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer), "SO_RCVBUF");
    check(::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience), "SO_RCVTIMEO");
    const sockaddr_in address = group_address();
    check(::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), "bind");
    ip_mreq membership{};
    membership.imr_multiaddr = address.sin_addr;
    membership.imr_interface.s_addr = htonl(INADDR_LOOPBACK);
    check(::setsockopt(fd_, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership),
          "IP_ADD_MEMBERSHIP");
  }
  ~Receiver() { ::close(fd_); }
  Receiver(const Receiver&) = delete;
  Receiver& operator=(const Receiver&) = delete;

  /// Arrival less time in the log, ns, by index, until nothing comes any more.
  std::map<std::int64_t, double> errors_ns(std::int64_t count) {
    std::map<std::int64_t, double> errors;
    std::array<std::uint8_t, 2048> bytes;
    std::array<char, 256> notes;
    std::int64_t begin_ns = 0;
    while (static_cast<std::int64_t>(errors.size()) < count) {
      iovec vector{bytes.data(), bytes.size()};
      msghdr header{};
      header.msg_iov = &vector;
      header.msg_iovlen = 1;
      header.msg_control = notes.data();
      header.msg_controllen = notes.size();
      const ssize_t size = ::recvmsg(fd_, &header, 0);
      if (size < 0) break;
      if (static_cast<std::size_t>(size) != kPrefix + kPayload ||
          std::memcmp(bytes.data() + kHeaderBytes, kChannel, sizeof kChannel) != 0) {
        continue;  // a probe of liblcm's
      }
      std::int64_t index = 0;
      std::memcpy(&index, bytes.data() + kPrefix, sizeof index);
      timespec stamp{};
      std::memcpy(&stamp, CMSG_DATA(CMSG_FIRSTHDR(&header)), sizeof stamp);
      const std::int64_t at_ns = stamp.tv_sec * 1'000'000'000 + stamp.tv_nsec;
      if (errors.empty()) begin_ns = at_ns;
      errors[index] = static_cast<double>(at_ns - begin_ns - index * kPeriod_us * 1000);
    }
    return errors;
  }

 private:
  int fd_;
};

/// Nothing but a timer and a send, in a process of its own as the others.
/// @param priority of SCHED_FIFO, where it is permitted; 0: as every process
pid_t start_bare_timer(std::int64_t count, int priority) {
  const pid_t child = check(::fork(), "fork");
  if (child != 0) return child;
  const sched_param parameter{.sched_priority = priority};
  if (priority > 0) static_cast<void>(::sched_setscheduler(0, SCHED_FIFO, &parameter));
  const int fd = ::socket(AF_INET, SOCK_DGRAM, 0);
  const sockaddr_in address = group_address();
  std::vector<std::uint8_t> packet(kPrefix + kPayload);
  std::memcpy(packet.data(), "LC02", 4);
  std::memcpy(packet.data() + kHeaderBytes, kChannel, sizeof kChannel);
  timespec deadline{};
  ::clock_gettime(CLOCK_MONOTONIC, &deadline);
  deadline.tv_sec += 1;
  for (std::int64_t i = 0; i < count; ++i) {
    std::memcpy(packet.data() + kPrefix, &i, sizeof i);
    ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, nullptr);
    ::sendto(fd, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&address),
             sizeof address);
    deadline.tv_nsec += kPeriod_us * 1000;
    if (deadline.tv_nsec >= 1'000'000'000) {
      deadline.tv_nsec -= 1'000'000'000;
      ++deadline.tv_sec;
    }
  }
  ::_exit(0);
}

pid_t start_program(const std::vector<std::string>& arguments) {
  const pid_t child = check(::fork(), "fork");
  if (child != 0) return child;
  static_cast<void>(std::freopen("/dev/null", "w", stdout));
  std::vector<char*> argv;
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  ::execvp(argv[0], argv.data());
  ::_exit(127);
}

struct Timing {
  double p50_us = 0.0, p99_us = 0.0, most_us = 0.0, drift_us = 0.0;
  std::int64_t lost = 0;
};

double quantile(std::vector<double> values, double q) {
  const auto at = static_cast<std::size_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return values[at];
}

Timing timing_of(const std::map<std::int64_t, double>& errors_ns, std::int64_t count) {
  if (errors_ns.empty()) throw std::runtime_error("nothing arrived: is there a multicast route?");
  std::vector<double> errors, sizes;
  double first = 0.0, last = 0.0;
  std::int64_t first_count = 0, last_count = 0;
  for (const auto& [index, error] : errors_ns) {
    errors.push_back(error * 1e-3);
    if (index < kCyclesPerSecond) first += error * 1e-3, ++first_count;
    if (index >= count - kCyclesPerSecond) last += error * 1e-3, ++last_count;
  }
  const double median = quantile(errors, 0.5);
  for (const double error : errors) sizes.push_back(std::abs(error - median));
  return {.p50_us = quantile(sizes, 0.5),
          .p99_us = quantile(sizes, 0.99),
          .most_us = quantile(sizes, 1.0),
          .drift_us = last / static_cast<double>(std::max<std::int64_t>(last_count, 1)) -
                      first / static_cast<double>(std::max<std::int64_t>(first_count, 1)),
          .lost = count - static_cast<std::int64_t>(errors.size())};
}

void run(const std::filesystem::path& program, std::int64_t seconds, int rounds) {
  const std::int64_t count = seconds * kCyclesPerSecond;
  const auto file =
      std::filesystem::temp_directory_path() / fmt::format("faultline-playback-{}.lcm", ::getpid());
  write_log(file, count);
  const std::vector<std::pair<std::string, std::function<pid_t()>>> players{
      {"bare timer", [&] { return start_bare_timer(count, 0); }},
      {"bare, SCHED_FIFO", [&] { return start_bare_timer(count, kPriority); }},
      {"faultline play",
       [&] {
         return start_program(
             {program.string(), "play", file.string(), "--bus", fmt::format("lcm:{}", kUrl), "-q"});
       }},
      {"lcm-logplayer", [&] {
         return start_program({"lcm-logplayer", "-l", kUrl, file.string()});
       }}};
  fmt::print("{} s at 1 kHz, {} B; error of arrival, us\n", seconds, kPayload);
  fmt::print("{:<18}{:>7}{:>10}{:>10}{:>11}{:>10}{:>7}\n", "", "round", "p50", "p99", "max",
             "drift", "lost");
  std::vector<std::vector<double>> p50s(players.size()), p99s(players.size());
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t i = 0; i < players.size(); ++i) {
      // Each goes first in turn.
      const std::size_t at = (i + static_cast<std::size_t>(round)) % players.size();
      Receiver receiver;
      const pid_t child = players[at].second();
      const Timing timing = timing_of(receiver.errors_ns(count), count);
      ::waitpid(child, nullptr, 0);
      fmt::print("{:<18}{:>7}{:>10.2f}{:>10.1f}{:>11.1f}{:>10.2f}{:>7}\n", players[at].first,
                 round + 1, timing.p50_us, timing.p99_us, timing.most_us, timing.drift_us,
                 timing.lost);
      std::fflush(stdout);
      p50s[at].push_back(timing.p50_us);
      p99s[at].push_back(timing.p99_us);
    }
  }
  std::filesystem::remove(file);
  fmt::print("medians of the rounds, and their ratio to the bare timer's\n");
  for (std::size_t i = 0; i < players.size(); ++i) {
    const double p50 = quantile(p50s[i], 0.5), p99 = quantile(p99s[i], 0.5);
    fmt::print("{:<18}{:>7}{:>10.2f}{:>10.1f}   p50 x{:.2f}  p99 x{:.2f}\n", players[i].first, "",
               p50, p99, p50 / quantile(p50s[0], 0.5), p99 / quantile(p99s[0], 0.5));
  }
}

}  // namespace
}  // namespace faultline

int main(int argc, char** argv) {
  const std::int64_t seconds = argc > 1 ? std::atoll(argv[1]) : 20;
  const int rounds = argc > 2 ? std::atoi(argv[2]) : 3;
  try {
    const auto program = std::filesystem::canonical("/proc/self/exe").parent_path() / "faultline";
    faultline::run(program, std::max<std::int64_t>(seconds, 2), std::max(rounds, 1));
  } catch (const std::exception& error) {
    fmt::print(stderr, "playback_benchmark: {}\n", error.what());
    return 1;
  }
  return 0;
}

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include <fcntl.h>
#include <unistd.h>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "drivers/can/bus_socket.h"
#include "drivers/can/can_bus.h"
#include "drivers/can/can_interface.h"
#include "drivers/can/input_backlog.h"
#include "drivers/can/socketcan_bus.h"
#include "tools/doctor/checks.h"
#include "tools/lcm/lcm_source.h"
#include "tools/lcm/message_sink.h"

namespace faultline {
namespace {

// LCM's own default, kept on this machine.
constexpr char kGroup[] = "239.255.76.67";
constexpr std::uint16_t kPort = 7667;
constexpr char kUrl[] = "udpm://239.255.76.67:7667?ttl=0";

const std::vector<std::string> kMulticastRemedies{"ip link set lo up multicast on",
                                                  "ip route add 224.0.0.0/4 dev lo"};

/// Where `program` is by PATH; empty if nowhere.
std::string find_program(std::string_view program) {
  const char* const path = std::getenv("PATH");
  std::istringstream folders(path != nullptr ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');) {
    const std::string file = fmt::format("{}/{}", folder, program);
    if (::access(file.c_str(), X_OK) == 0 && std::filesystem::is_regular_file(file)) return file;
  }
  return "";
}

bool does_loopback_carry_multicast(const Socket& socket) {
  ifreq request{};
  std::strcpy(request.ifr_name, "lo");
  if (::ioctl(socket.fd(), SIOCGIFFLAGS, &request) != 0) return false;
  constexpr short kWanted = IFF_UP | IFF_MULTICAST;
  return (request.ifr_flags & kWanted) == kWanted;
}

/// Address by which a datagram to LCM's group leaves; nothing if there is no route, with errno set.
/// By lo it may be none: 127.0.0.1 is valid within the host only.
std::optional<in_addr> way_to_group(const Socket& socket) {
  sockaddr_in group{};
  group.sin_family = AF_INET;
  group.sin_port = htons(kPort);
  group.sin_addr.s_addr = ::inet_addr(kGroup);
  if (::connect(socket.fd(), reinterpret_cast<const sockaddr*>(&group), sizeof group) != 0) {
    return std::nullopt;
  }
  sockaddr_in local{};
  socklen_t size = sizeof local;
  if (::getsockname(socket.fd(), reinterpret_cast<sockaddr*>(&local), &size) != 0) {
    return std::nullopt;
  }
  return local.sin_addr;
}

Socket udp_socket() { return Socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)); }

/// Waits for a message like the one that was sent.

}  // namespace

Finding check_can_in_kernel() {
  Finding finding{.check = "CAN in the kernel"};
  try {
    const Socket socket = open_can_socket("CAN");
    finding.found = "CAN sockets can be opened";
  } catch (const BusError& error) {
    const bool has_uml = !find_program("linux.uml").empty() || !find_program("linux").empty();
    finding.status = has_uml ? FindingStatus::kWarn : FindingStatus::kFail;
    finding.found = error.what();
    if (!has_uml) {
      finding.remedies.emplace_back("sudo apt install user-mode-linux iproute2 kmod util-linux");
    }
    finding.remedies.emplace_back("tools/with-vcan -- faultline ...   # has CAN wherever it runs");
  }
  return finding;
}

Finding check_can_interfaces() {
  Finding finding{.check = "CAN interfaces"};
  std::vector<std::string> up, down;
  struct if_nameindex* const interfaces = ::if_nameindex();
  for (const struct if_nameindex* entry = interfaces; entry != nullptr && entry->if_index != 0;
       ++entry) {
    const InterfaceState state = read_interface(entry->if_name);
    if (state.is_can) (state.is_up ? up : down).emplace_back(entry->if_name);
  }
  if (interfaces != nullptr) ::if_freenameindex(interfaces);
  if (!up.empty()) {
    finding.found = fmt::format("up: {}", fmt::join(up, ", "));
    return finding;
  }
  finding.status = FindingStatus::kWarn;
  if (check_can_in_kernel().status != FindingStatus::kOk) {
    finding.found = "none without CAN in the kernel";
    return finding;
  }
  finding.found =
      down.empty() ? std::string("none") : fmt::format("all down: {}", fmt::join(down, ", "));
  if (down.empty()) finding.remedies.emplace_back("sudo ip link add dev vcan0 type vcan");
  finding.remedies.push_back(
      fmt::format("sudo ip link set {} up", down.empty() ? "vcan0" : down.front()));
  return finding;
}

Finding check_multicast() {
  Finding finding{.check = "multicast"};
  const Socket socket = udp_socket();
  const std::optional<in_addr> local = way_to_group(socket);
  const int error = errno;
  const std::uint32_t address = local ? ntohl(local->s_addr) : 0;
  const bool is_loopback = address == INADDR_ANY || (address >> 24) == IN_LOOPBACKNET;
  if (!local) {
    finding.status = FindingStatus::kFail;
    finding.found = fmt::format("no route to {}: {}", kGroup, errno_text(error));
    finding.remedies = kMulticastRemedies;
  } else if (is_loopback && !does_loopback_carry_multicast(socket)) {
    finding.status = FindingStatus::kFail;
    finding.found = fmt::format("the route to {} is by lo, which carries no multicast", kGroup);
    finding.remedies = {kMulticastRemedies.front()};
  } else {
    finding.found = is_loopback ? fmt::format("{} is reached by lo", kGroup)
                                : fmt::format("{} is reached from {}", kGroup, ::inet_ntoa(*local));
  }
  return finding;
}

Finding check_lcm() {
  Finding finding{.check = "LCM round trip"};
  finding.status = FindingStatus::kFail;
  if (!way_to_group(udp_socket())) {  // liblcm would try for ten seconds
    finding.found = "not tried: there is no multicast";
    finding.remedies = kMulticastRemedies;
    return finding;
  }
  constexpr char kChannel[] = "FAULTLINE_DOCTOR";
  const std::string text =
      fmt::format("{:08x}{:08x}", std::random_device()(), std::random_device()());
  const std::vector<std::uint8_t> wanted(text.begin(), text.end());
  bool is_heard = false;
  const auto on_message = [&](const LiveMessage& message) {
    is_heard = is_heard ||
               std::equal(message.data.begin(), message.data.end(), wanted.begin(), wanted.end());
  };
  std::chrono::steady_clock::time_point sent;
  try {
    LcmSource source(kUrl, kChannel);
    const std::unique_ptr<MessageSink> sink = open_live(kUrl);
    sent = std::chrono::steady_clock::now();
    sink->publish(kChannel, 0, wanted);
    constexpr auto kPatience = std::chrono::seconds(2);
    while (!is_heard && std::chrono::steady_clock::now() < sent + kPatience) {
      source.receive(std::chrono::milliseconds(100), on_message);
    }
  } catch (const std::runtime_error& error) {  // MessageSourceError, MessageSinkError
    finding.found = error.what();
    finding.remedies = kMulticastRemedies;
    return finding;
  }
  const std::chrono::duration<double, std::micro> trip = std::chrono::steady_clock::now() - sent;
  if (is_heard) {
    finding.status = FindingStatus::kOk;
    finding.found = fmt::format("{}: a message came back in {:.0f} us", kUrl, trip.count());
  } else {
    finding.found = fmt::format(
        "{}: a message was sent and did not come back: is UDP port {} "
        "filtered?",
        kUrl, kPort);
    finding.remedies = {"sudo nft list ruleset"};
  }
  return finding;
}

Finding check_lcm_logger() {
  const std::string file = find_program("lcm-logger");
  if (!file.empty()) return {.check = "lcm-logger", .found = file};
  return {.check = "lcm-logger",
          .status = FindingStatus::kWarn,
          .found = "not in PATH: logs can be written by the bench only",
          .remedies = {"sudo apt install liblcm-bin"}};
}

Finding check_receive_buffer() {
  Finding finding{.check = "receive buffers"};
  const int wanted = SocketCanOptions{}.receive_buffer_bytes;
  const std::string most = first_line("/proc/sys/net/core/rmem_max");
  if (most.empty()) {
    finding.found = "this kernel or container does not tell net.core.rmem_max";
    return finding;
  }
  finding.found = fmt::format("net.core.rmem_max is {} B", most);
  if (std::strtoll(most.c_str(), nullptr, 10) >= wanted) return finding;
  finding.status = FindingStatus::kWarn;
  finding.found += fmt::format(", {} B are asked for: bursts may be dropped (and counted)", wanted);
  finding.remedies.push_back(fmt::format("sudo sysctl -w net.core.rmem_max={}", wanted));
  return finding;
}

Finding check_input_backlog() {
  Finding finding{.check = "input backlog"};
  const std::optional<std::uint64_t> drops = input_backlog_drops();
  if (!drops) {
    finding.found = "this kernel or container does not tell its drops";
    return finding;
  }
  const std::string most = first_line("/proc/sys/net/core/netdev_max_backlog");
  if (!most.empty())
    finding.found = fmt::format("net.core.netdev_max_backlog is {} packets, ", most);
  if (*drops == 0) {
    finding.found += "none dropped";
    return finding;
  }
  finding.status = FindingStatus::kWarn;
  finding.found += fmt::format(
      "{} dropped since the machine started: floods of vcan or lo may lose frames before any "
      "socket",
      *drops);
  finding.remedies.emplace_back(kBacklogRemedy);
  return finding;
}

}  // namespace faultline

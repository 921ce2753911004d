#include "drivers/can/open_bus.h"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <optional>
#include <stdexcept>

#include "drivers/can/bus_group.h"
#include "drivers/can/multicast_group.h"
#include "drivers/can/socketcan_bus.h"
#include "drivers/can/udp_bus.h"

namespace faultline {
namespace {

constexpr std::string_view kCanPrefix = "can:";
constexpr std::string_view kUdpPrefix = "udp:";
constexpr std::string_view kExpected =
    "can:IFACE, udp:GROUP:PORT or several with commas between them, e.g. can:vcan0 or "
    "udp:239.74.163.2:43113";

[[noreturn]] void refuse(std::string_view spec, std::string_view expected) {
  throw std::invalid_argument("bus: found \"" + std::string(spec) + "\", expected " +
                              std::string(expected));
}

struct GroupAndPort {
  std::string group;
  std::uint16_t port = 0;
};

std::optional<std::uint16_t> parse_port(std::string_view text) {
  std::uint16_t port = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), port);
  if (error != std::errc() || end != text.data() + text.size() || port == 0) return std::nullopt;
  return port;
}

/// "239.74.163.2:43113" or "[ff15::1]:43113".
GroupAndPort parse_group_and_port(std::string_view spec) {
  const std::string_view rest = spec.substr(kUdpPrefix.size());
  std::string_view group, port_text;
  if (rest.starts_with('[')) {
    const std::size_t close = rest.find(']');
    if (close == std::string_view::npos || rest.substr(close + 1, 1) != ":") {
      refuse(spec, "udp:[GROUP]:PORT, e.g. udp:[ff15::1]:43113");
    }
    group = rest.substr(1, close - 1);
    port_text = rest.substr(close + 2);
  } else {
    const std::size_t colon = rest.find(':');
    if (colon == std::string_view::npos)
      refuse(spec, "udp:GROUP:PORT, e.g. udp:239.74.163.2:43113");
    if (rest.find(':', colon + 1) != std::string_view::npos) {
      refuse(spec, "brackets around an IPv6 group, e.g. udp:[ff15::1]:43113");
    }
    group = rest.substr(0, colon);
    port_text = rest.substr(colon + 1);
  }
  const auto port = parse_port(port_text);
  if (!port) refuse(spec, "a port from 1 to 65535");
  if (!parse_multicast_address(std::string(group), *port)) {
    refuse(spec, "the number of a multicast group, 224.0.0.0/4 or [ff00::]/8");
  }
  const bool has_brackets = rest.starts_with('[');
  if (has_brackets != (group.find(':') != std::string_view::npos)) {
    refuse(spec, "brackets around an IPv6 group only");
  }
  return {std::string(group), *port};
}

void check_bus_name(std::string_view spec) {
  if (spec == "loop") {
    refuse(spec, "a bus with another end: a loop begins and ends in one process (" +
                     std::string(kExpected) + ")");
  }
  if (spec.starts_with(kCanPrefix)) {
    if (spec.size() == kCanPrefix.size()) refuse(spec, "the name of an interface: can:IFACE");
  } else if (spec.starts_with(kUdpPrefix)) {
    static_cast<void>(parse_group_and_port(spec));
  } else {
    refuse(spec, kExpected);
  }
}

std::unique_ptr<CanBus> open_one(const std::string& spec) {
  if (spec.starts_with(kUdpPrefix)) {
    const GroupAndPort address = parse_group_and_port(spec);
    return std::make_unique<UdpBus>(address.group, address.port);
  }
  return open_socketcan(spec.substr(kCanPrefix.size()));
}

}  // namespace

void check_bus_names(std::string_view spec) {
  for (const std::string& name : split_bus_names(spec)) check_bus_name(name);
}

std::vector<std::string> split_bus_names(std::string_view spec) {
  std::vector<std::string> names;
  for (std::size_t begin = 0;;) {
    const std::size_t comma = std::min(spec.find(',', begin), spec.size());
    if (comma == begin) refuse(spec, "the name of a bus at each side of a comma");
    names.emplace_back(spec.substr(begin, comma - begin));
    if (comma == spec.size()) return names;
    begin = comma + 1;
  }
}

std::unique_ptr<CanBus> open_bus(std::string_view spec) {
  const std::vector<std::string> names = split_bus_names(spec);
  for (const std::string& name : names) check_bus_name(name);
  if (names.size() == 1) return open_one(names.front());
  std::vector<std::unique_ptr<CanBus>> members;
  members.reserve(names.size());
  for (const std::string& name : names) members.push_back(open_one(name));
  return std::make_unique<BusGroup>(std::move(members));
}

}  // namespace faultline

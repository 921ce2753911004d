#include "tools/lcm/lcm_url.h"

#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <stdexcept>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>

namespace faultline {
namespace {

// What liblcm takes where an address or a port is left out (lcm_udpm.c, lcm_tcpq.c).
constexpr std::string_view kDefaultGroup = "239.255.76.67";
constexpr std::string_view kDefaultPort = "7667";
constexpr std::string_view kDefaultHost = "localhost";
constexpr std::string_view kDefaultTcpPort = "7700";

constexpr std::int64_t kLargestTtl = 255;
constexpr std::int64_t kLargestBuffer = INT32_MAX;

struct LcmUrl {
  std::string_view provider, network, options;
};

[[noreturn]] void refuse(std::string_view url, const std::string& found,
                         std::string_view expected) {
  throw std::invalid_argument(
      fmt::format("LCM URL \"{}\": found {}, expected {}", url, found, expected));
}

std::string quoted(std::string_view text) { return fmt::format("\"{}\"", text); }

LcmUrl split_url(std::string_view url) {
  constexpr std::string_view kColon = "://";
  const std::size_t colon = url.find(kColon);
  if (colon == std::string_view::npos) {
    refuse(url, "no \"://\"", "a URL such as udpm://239.255.76.67:7667?ttl=0");
  }
  const std::string_view rest = url.substr(colon + kColon.size());
  const std::size_t mark = std::min(rest.find('?'), rest.size());
  return {url.substr(0, colon), rest.substr(0, mark),
          mark < rest.size() ? rest.substr(mark + 1) : std::string_view()};
}

std::optional<std::int64_t> parse_number(std::string_view text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// Address and port, the provider's own where they are left out.
struct Place {
  std::string_view address, port;
};

Place place_of(const LcmUrl& parts) {
  const bool is_tcp = parts.provider == "tcpq";
  const std::size_t colon = std::min(parts.network.find(':'), parts.network.size());
  Place place{parts.network.substr(0, colon), parts.network.substr(colon)};
  if (!place.port.empty()) place.port.remove_prefix(1);
  if (place.address.empty()) place.address = is_tcp ? kDefaultHost : kDefaultGroup;
  if (place.port.empty()) place.port = is_tcp ? kDefaultTcpPort : kDefaultPort;
  return place;
}

void check_place(std::string_view url, const LcmUrl& parts) {
  const Place place = place_of(parts);
  const auto port = parse_number(place.port);
  if (!port || *port < 1 || *port > UINT16_MAX) {
    refuse(url, quoted(place.port), "a port from 1 to 65535");
  }
  if (parts.provider == "tcpq") return;
  in_addr address{};
  if (::inet_pton(AF_INET, std::string(place.address).c_str(), &address) != 1 ||
      !IN_MULTICAST(ntohl(address.s_addr))) {
    refuse(url, quoted(place.address),
           "the number of an IPv4 multicast group (224.0.0.0 to 239.255.255.255)");
  }
}

void check_number_option(std::string_view url, std::string_view key, std::string_view value,
                         std::int64_t smallest, std::int64_t largest) {
  const auto number = parse_number(value);
  if (number && *number >= smallest && *number <= largest) return;
  refuse(url, fmt::format("{}={}", key, value),
         fmt::format("a number from {} to {}", smallest, largest));
}

void check_multicast_options(std::string_view url, std::string_view options) {
  while (!options.empty()) {
    const std::size_t end = std::min(options.find('&'), options.size());
    const std::string_view option = options.substr(0, end);
    options.remove_prefix(std::min(end + 1, options.size()));
    const std::size_t equals = std::min(option.find('='), option.size());
    const std::string_view key = option.substr(0, equals);
    const std::string_view value =
        equals < option.size() ? option.substr(equals + 1) : std::string_view();
    if (key == "ttl") {
      check_number_option(url, key, value, 0, kLargestTtl);
    } else if (key == "recv_buf_size") {
      check_number_option(url, key, value, 1, kLargestBuffer);
    } else {
      refuse(url, quoted(option), "ttl=N or recv_buf_size=N, with & between them");
    }
  }
}

bool is_multicast(std::string_view provider) { return provider == "udpm" || provider == "mpudpm"; }

}  // namespace

void check_lcm_url(std::string_view url) {
  const LcmUrl parts = split_url(url);
  if (is_multicast(parts.provider)) {
    check_place(url, parts);
    check_multicast_options(url, parts.options);
  } else if (parts.provider == "tcpq") {
    check_place(url, parts);
  } else if (parts.provider == "file") {
    if (parts.network.empty()) refuse(url, "no file", "file://FILE");
  } else if (parts.provider != "memq") {
    refuse(url, quoted(parts.provider),
           "udpm, mpudpm, tcpq, memq or file, as in udpm://239.255.76.67:7667?ttl=0");
  }
}

void check_live_lcm_url(std::string_view url) {
  check_lcm_url(url);
  const std::string_view provider = split_url(url).provider;
  if (provider == "memq" || provider == "file") {
    refuse(url, quoted(provider),
           "udpm, mpudpm or tcpq: somebody else's messages (a log: faultline play LOG)");
  }
}

bool is_same_lcm_place(std::string_view a, std::string_view b) {
  const LcmUrl first = split_url(a), second = split_url(b);
  if (first.provider != second.provider) return false;
  if (!is_multicast(first.provider) && first.provider != "tcpq") {
    return first.network == second.network;
  }
  const Place there = place_of(first), here = place_of(second);
  return there.address == here.address && there.port == here.port;
}

std::string lcm_refusal_text(std::string_view url) {
  if (!is_multicast(split_url(url).provider)) return fmt::format("LCM {}: cannot open", url);
  return fmt::format(
      "LCM {}: cannot open: expected a multicast route; on this machine alone: "
      "`ip link set lo up multicast on` and `ip route add 224.0.0.0/4 dev lo`",
      url);
}

}  // namespace faultline

#include "tools/dashboard/viewer_access.h"

#include <charconv>
#include <stdexcept>

#include <boost/asio/ip/address.hpp>
#include <fmt/format.h>

namespace faultline {
namespace {

struct HostAndPort {
  std::string host, port;
};

/// "[::1]:8080" and "localhost:8080" in their parts.
HostAndPort split_port(std::string_view text) {
  const std::size_t bracket = text.starts_with('[') ? text.find(']') : std::string_view::npos;
  if (bracket != std::string_view::npos) {
    const std::string_view rest = text.substr(bracket + 1);
    // What follows the bracket without a colon is no port, and no host either.
    if (!rest.empty() && !rest.starts_with(':')) return {std::string(text), {}};
    return {std::string(text.substr(1, bracket - 1)),
            std::string(rest.empty() ? rest : rest.substr(1))};
  }
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos) return {std::string(text), {}};
  return {std::string(text.substr(0, colon)), std::string(text.substr(colon + 1))};
}

bool read_port(const std::string& text, std::uint16_t& port) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), port);
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

}  // namespace

bool ListenAddress::is_loopback() const noexcept {
  boost::system::error_code error;
  const auto parsed = boost::asio::ip::make_address(address, error);
  return !error && parsed.is_loopback();
}

ListenAddress parse_listen_address(const std::string& text) {
  const HostAndPort parts = split_port(text);
  ListenAddress result{.address = parts.host};
  boost::system::error_code error;
  static_cast<void>(boost::asio::ip::make_address(parts.host, error));
  if (error || !read_port(parts.port, result.port)) {
    throw std::invalid_argument(fmt::format(
        "--listen: found \"{}\", expected ADDRESS:PORT, as 127.0.0.1:8080 or [::1]:8080", text));
  }
  return result;
}

bool is_same_secret(std::string_view a, std::string_view b) noexcept {
  // Only the length of the one that was sent decides how long it takes.
  unsigned difference = a.size() == b.size() ? 0U : 1U;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const char other = b.empty() ? '\0' : b[i % b.size()];
    difference |= static_cast<unsigned>(a[i] ^ other);
  }
  return difference == 0U;
}

bool ViewerAccess::admits_host(std::string_view host) const {
  // An address is read up to a NUL.
  if (host.find('\0') != std::string_view::npos) return false;
  const HostAndPort parts = split_port(host);
  std::uint16_t named = 80;
  if (!parts.port.empty() && !read_port(parts.port, named)) return false;
  if (named != port) return false;
  if (parts.host == "localhost") return true;
  // A numeric address has no name that could be made to lead elsewhere.
  boost::system::error_code error;
  static_cast<void>(boost::asio::ip::make_address(parts.host, error));
  return !error;
}

bool ViewerAccess::admits_origin(std::string_view origin, std::string_view host) {
  constexpr std::string_view kScheme = "http://";
  return origin.starts_with(kScheme) && origin.substr(kScheme.size()) == host;
}

bool ViewerAccess::admits_target(std::string_view target) const {
  if (token.empty()) return true;
  constexpr std::string_view kKey = "token=";
  const std::size_t question = target.find('?');
  if (question == std::string_view::npos) return false;
  const std::string_view query = target.substr(question + 1);
  return query.starts_with(kKey) && is_same_secret(query.substr(kKey.size()), token);
}

}  // namespace faultline

#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace faultline {

/// Where the dashboard listens, from "ADDRESS:PORT"; an IPv6 address stands in brackets.
struct ListenAddress {
  std::string address;
  std::uint16_t port = 0;  ///< 0: any that is free
  [[nodiscard]] bool is_loopback() const noexcept;
};

/// @throws std::invalid_argument no numeric address with a port.
[[nodiscard]] ListenAddress parse_listen_address(const std::string& text);

/// Whether both are alike; takes as long wherever they differ.
[[nodiscard]] bool is_same_secret(std::string_view a, std::string_view b) noexcept;

/// Who may see the page. A page of another site may have its visitor's browser connect to us: it
/// names its own site as Origin, or, with a name of its own that leads here (DNS rebinding), as
/// Host.
struct ViewerAccess {
  std::string token;       ///< empty: none is asked for
  std::uint16_t port = 0;  ///< ours

  /// Host header: localhost or a numeric address, with our port (or none, if ours is 80).
  [[nodiscard]] bool admits_host(std::string_view host) const;
  /// Origin header of a WebSocket: "http://" and the Host that came with it.
  [[nodiscard]] static bool admits_origin(std::string_view origin, std::string_view host);
  /// The token, in the query of the target: "/?token=T".
  [[nodiscard]] bool admits_target(std::string_view target) const;
};

}  // namespace faultline

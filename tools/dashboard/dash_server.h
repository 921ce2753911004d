#pragma once

#include <functional>
#include <memory>
#include <string>

#include "tools/dashboard/viewer_access.h"

namespace faultline {

/// What a dashboard does.
struct DashOptions {
  std::string lcm_url;
  ListenAddress listen;
  std::string token;  ///< empty: none, which is for loopback only
};

/// The live page: HTTP for its files, a WebSocket (/live) for what the bench says and for requests
/// to it. Each viewer has one message under way at most and gets the newest state when it has taken
/// that, and the kernel keeps little for it: a slow one sees fewer states, not old ones, and
/// nothing piles up. Use from one thread.
class DashServer {
 public:
  /// Viewers at one time; others are told that there is no room.
  static constexpr std::size_t kViewers = 32;
  /// Connections at one time. Beyond them a new one takes the place of the one that has waited
  /// longest without asking for anything; if there is none, it is closed.
  static constexpr std::size_t kConnections = 4 * kViewers;

  /// @throws std::invalid_argument a LCM URL that is none, or no token where the address is not
  ///   loopback; std::runtime_error the port is in use, with the address;
  ///   MessageSourceError, MessageSinkError LCM cannot be opened.
  explicit DashServer(const DashOptions& options);
  ~DashServer();
  DashServer(const DashServer&) = delete;
  DashServer& operator=(const DashServer&) = delete;

  /// The port it listens on.
  [[nodiscard]] std::uint16_t port() const;
  /// Serves until `should_stop` says so, asked some 25 times a second.
  void run(const std::function<bool()>& should_stop);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline

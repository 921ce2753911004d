#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>

namespace faultline {

/// A message of another rank.
struct RankMessage {
  int from = 0;
  std::string text;
};

/// The other processes of a campaign under MPI, from one thread. MPI itself is in a module of its
/// own, which is loaded only where mpirun has started the program: it pulls in some twenty
/// libraries, and nothing else here needs them (docs/decisions/0037).
class RankLink {
 public:
  /// nullptr where the program was not started by mpirun or its like, or is alone.
  /// @throws std::runtime_error it was, but the module is not there or MPI cannot be started.
  [[nodiscard]] static std::unique_ptr<RankLink> open();
  /// Without close(), e.g. after an exception: ends all ranks.
  ~RankLink();
  RankLink(const RankLink&) = delete;
  RankLink& operator=(const RankLink&) = delete;

  [[nodiscard]] int rank() const noexcept { return rank_; }
  [[nodiscard]] int size() const noexcept { return size_; }
  /// Does not wait; messages to the same rank arrive in order.
  void send(int to, const std::string& text);
  /// The next message that is here; does not wait.
  [[nodiscard]] std::optional<RankMessage> receive();
  /// All ranks are done. Waits for them.
  void close();

 private:
  struct Module;
  RankLink();
  std::unique_ptr<Module> module_;
  int rank_ = 0;
  int size_ = 1;
};

}  // namespace faultline

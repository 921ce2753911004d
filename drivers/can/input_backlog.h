#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace faultline {

// The kernel's input backlog. What a host sends to itself (frames on a vcan, datagrams on lo) waits
// in a queue of the CPU, up to net.core.netdev_max_backlog packets, until the kernel hands it to
// the sockets. A flood that the kernel cannot follow overflows it; what is lost there reached no
// socket, so that no BusCounters::dropped knows of it.

/// Sum of the packets dropped, since the machine started, by the backlogs of all CPUs. Of all
/// interfaces and network namespaces: the kernel does not tell them apart.
/// @param softnet_stat text of /proc/net/softnet_stat: a line a CPU of hexadecimal columns, of
/// which the second is wanted (the kernel's net/core/net-procfs.c; 32 bits, wraps).
/// @return nothing if that is no such text.
[[nodiscard]] std::optional<std::uint64_t> read_backlog_drops(std::string_view softnet_stat);

/// The same of this machine, now; nothing where it does not tell.
[[nodiscard]] std::optional<std::uint64_t> input_backlog_drops();

/// Counts the drops from its construction on.
class InputBacklogWatch {
 public:
  /// Since construction; 0 where the machine does not tell.
  [[nodiscard]] std::uint64_t drops() const;

 private:
  std::optional<std::uint64_t> at_start_ = input_backlog_drops();
};

/// "the kernel dropped 12 packets before any socket got them: ...", with what to do.
[[nodiscard]] std::string backlog_drops_text(std::uint64_t drops);

/// What is worth typing against such drops.
inline constexpr std::string_view kBacklogRemedy =
    "sudo sysctl -w net.core.netdev_max_backlog=10000";

}  // namespace faultline

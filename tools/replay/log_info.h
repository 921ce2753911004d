#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace faultline {

/// What a log contains.
struct LogInfo {
  struct Channel {
    std::uint64_t messages = 0;
    std::uint64_t bytes = 0;
    std::uint64_t missing = 0;  ///< gaps in the sequence numbers
  };
  struct Part {
    std::string part, name, digest;
    bool is_complete = false;
  };
  struct VerdictChange {
    std::int64_t cycle = 0;
    double t_s = 0.0;  ///< since the first message of the log
    std::string verdict;
    std::vector<std::vector<std::string>> sets;
  };
  std::uint64_t messages = 0;
  double duration_s = 0.0;
  std::map<std::string, Channel> channels;
  std::vector<Part> parts;
  std::vector<VerdictChange> verdicts;
  std::uint64_t undecodable = 0;  ///< messages on our channels that are not of our types
};

/// Reads an LCM log through, ours or another's.
/// @throws std::system_error it cannot be read; std::invalid_argument it is no LCM log.
[[nodiscard]] LogInfo read_log_info(const std::filesystem::path& file);

}  // namespace faultline

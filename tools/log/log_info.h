#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "tools/lcm/log_reader.h"

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
  struct Estimate {
    std::string fault;
    double value = 0.0;
    double deviation = 0.0;  ///< negative: not known
  };
  struct VerdictChange {
    std::int64_t cycle = 0;
    double t_s = 0.0;  ///< since the first message of the log
    std::string verdict;
    std::string cause;              ///< the last one of this verdict
    std::int64_t onset_cycle = -1;  ///< the estimated one where there is an estimate; -1: none
    std::vector<std::vector<std::string>> sets;
    std::vector<Estimate> estimates;  ///< the last ones of this verdict
    std::string blame;  ///< inhibited: the first message to blame and what it did; may be empty
  };
  std::uint64_t messages = 0;
  double duration_s = 0.0;
  std::map<std::string, Channel> channels;
  std::vector<Part> parts;
  std::vector<VerdictChange> verdicts;
  std::vector<LogDamage> damages;
  std::uint64_t undecodable = 0;  ///< messages on our channels that are not of our types
};

/// Reads an LCM log through, ours or another's, and past what is damaged in it.
/// @throws std::system_error it cannot be read; std::invalid_argument it is no LCM log.
[[nodiscard]] LogInfo read_log_info(const std::filesystem::path& file);

}  // namespace faultline

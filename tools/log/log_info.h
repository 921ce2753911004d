#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <faultline/stats_t.hpp>

#include "tools/log/log_files.h"

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
    bool is_complete = false;  ///< all of it is there, and has that digest
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
  double duration_s = 0.0;       ///< from the first message to the latest
  std::int64_t first_utime = 0;  ///< µs since 1970
  std::string run_id;            ///< of the last run in it; empty: none is named
  std::optional<std::int64_t> first_cycle, last_cycle;  ///< of the samples
  std::optional<stats_t> stats;                         ///< the last one; its end says is_final
  std::map<std::string, Channel> channels;
  std::vector<Part> parts;
  std::vector<VerdictChange> verdicts;
  std::vector<FileDamage> damages;
  std::uint64_t undecodable = 0;  ///< messages on our channels that are not of our types
};

/// Reads an LCM log through, ours or another's, and past what is damaged in it.
/// @param files of one log, in order.
/// @throws std::system_error one cannot be read; std::invalid_argument it is no LCM log.
[[nodiscard]] LogInfo read_log_info(const std::vector<std::string>& files);

}  // namespace faultline

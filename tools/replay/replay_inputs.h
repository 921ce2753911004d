#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tools/replay/bank_replay.h"
#include "tools/replay/log_replay.h"

namespace faultline {

/// The banks a record is replayed with.
struct ReplayBanks {
  /// The bank of the log, or of the scenario given instead.
  std::optional<ReplayInputs> own;
  bool is_recorded = false;  ///< it is the log's: its results can be compared
  std::string own_source;
  /// The bank given beside it.
  std::optional<ReplayInputs> other;
  std::string other_source;
};

/// @param parts the whole parts that the log carries; none of a candump log
/// @param log its name, for messages
/// @throws InputError there is no bank or no DBC to read the frames by; the other bank runs at
///   another rate than the log's; else as `replay`.
[[nodiscard]] ReplayBanks replay_banks(const ReplayOptions& options,
                                       const std::vector<RunPart>& parts, const std::string& log);

}  // namespace faultline

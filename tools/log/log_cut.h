#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace faultline {

/// What to keep of a log. Ends are not included: cuts from 0 to 5 and from 5 to 10 share nothing
/// but RUN and a batch of frames across the border.
struct LogCut {
  std::optional<double> from_s, to_s;                ///< since the log's first event
  std::optional<std::int64_t> from_cycle, to_cycle;  ///< instead of times
  std::vector<std::string> channels;                 ///< none: all
};

struct LogCutResult {
  std::uint64_t events = 0;  ///< kept
  std::uint64_t bytes = 0;
  std::uint64_t damages = 0;  ///< of the log; none of them is kept
};

/// Writes the events of `log` that `cut` chooses to `out`, to the byte as they stand in `log`:
/// their numbers and times are kept. RUN is kept whatever is chosen, so that the cut can be
/// replayed. What has no cycle is kept by cycle if it lies between the samples of these cycles. A
/// FAULTLINE_CAN message is kept if any of its frames is to be. `out` appears when it is complete;
/// an LCM log of that name is replaced.
/// @throws std::invalid_argument `out` is `log` or no LCM log, nothing is to be kept, a channel is
/// not
///   in the log; OutputError `out` cannot be written; as LogReader.
LogCutResult cut_log(const std::string& log, const std::string& out, const LogCut& cut);

}  // namespace faultline

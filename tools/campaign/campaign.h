#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "tools/campaign/campaign_database.h"
#include "tools/campaign/campaign_inputs.h"
#include "tools/campaign/rank_link.h"

namespace faultline {

/// A part of a campaign for one of several machines: runs r with r mod count = index - 1.
struct Shard {
  std::uint64_t index = 1;
  std::uint64_t count = 1;
  [[nodiscard]] bool has(std::uint64_t run) const noexcept { return run % count == index - 1; }
};

/// How far a campaign is.
struct CampaignProgress {
  std::uint64_t done = 0;   ///< of `total`, those of earlier processes among them
  std::uint64_t total = 0;  ///< runs of the shard
  std::uint64_t done_here = 0;
  double wall_s = 0.0;  ///< since this process began
  [[nodiscard]] double rate_per_s() const noexcept {
    return wall_s > 0.0 ? static_cast<double>(done_here) / wall_s : 0.0;
  }
};

struct CampaignOptions {
  unsigned threads = 1;  ///< of this process
  Shard shard;
  std::function<void(const CampaignProgress&)> on_progress;  ///< a few times a second
};

struct CampaignResult {
  CampaignProgress progress;
  int signal = 0;  ///< that asked to stop; the rows so far are there
};

/// Does the runs of a campaign that `database` has not got yet, on `threads` threads, and with
/// `link` on those of all other ranks, which call serve_campaign. Handles SIGINT and SIGTERM: runs
/// that have begun are finished, rows committed.
/// @throws DatabaseError; what was committed before stays. std::runtime_error a rank has other
/// files.
[[nodiscard]] CampaignResult run_campaign(const CampaignInputs& inputs, CampaignDatabase& database,
                                          const CampaignOptions& options, RankLink* link);

/// On all ranks but 0: does the runs that rank 0 hands out, until there are no more.
void serve_campaign(const CampaignInputs& inputs, unsigned threads, RankLink& link);

}  // namespace faultline

#pragma once

#include "tools/campaign/campaign_inputs.h"
#include "tools/campaign/campaign_row.h"

namespace faultline {

/// Runs a point in lock-step on the bus `loop`, without a log, and says what came of it. What goes
/// wrong within the run (a plant that diverges, values that do not fit together) is the row's
/// `error`. For any thread.
[[nodiscard]] CampaignRow run_point(const CampaignInputs& campaign, std::uint64_t run);

}  // namespace faultline

#pragma once

#include <string>
#include <vector>

#include "tools/score/scorecard.h"

namespace faultline {

/// Scorecards of banks, side by side, as one HTML page that needs no other file, no network and no
/// script. Cards of one sweep stand in one chart; of two with the same runs it says how they
/// differ, run by run. Several sweeps follow each other, below a table of all banks.
/// @param names what to call them; as many as cards
[[nodiscard]] std::string score_page(const std::vector<Scorecard>& cards,
                                     const std::vector<std::string>& names,
                                     const std::string& version);

}  // namespace faultline

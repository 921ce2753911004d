#pragma once

#include <string>

#include "tools/dashboard/live_view.h"

namespace faultline {

/// What the page needs to know once per run: names of residuals, faults and messages, the structure
/// matrix, the sample time. A JSON object of "type": "run".
[[nodiscard]] std::string run_json(const LiveView& view);

/// What changes all the time: a JSON object of "type": "state". Evaluation signals come with their
/// smallest and largest value since LiveView::reset_peaks(). Numbers that are none are null.
[[nodiscard]] std::string state_json(const LiveView& view, LiveView::Clock::time_point now);

}  // namespace faultline

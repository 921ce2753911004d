#pragma once

#include <array>
#include <string>
#include <vector>

#include "tools/report/run_record.h"

namespace faultline {

/// A bar on a lane of the timeline.
struct TimelineBar {
  CycleRange cycles;
  std::string words;  ///< shown in it where there is room, and as its tooltip
  std::string css;    ///< class: its colour
};

struct TimelineLane {
  std::string name;
  std::vector<TimelineBar> bars;
};

/// Lanes below each other over `cycles`, with an axis in seconds, as an inline SVG. Stretches too
/// narrow to be seen that follow each other are drawn as one of class "changing".
/// @param label what the picture shows, for those who do not see it
[[nodiscard]] std::string timeline_svg(const std::vector<TimelineLane>& lanes, CycleRange cycles,
                                       double sample_time_s, const std::string& label);

/// A histogram as an inline SVG: a bar per count, on a logarithmic scale, so that one among a
/// million shows; below it where the first begins and the last ends.
[[nodiscard]] std::string histogram_svg(const std::vector<double>& counts,
                                        const std::array<std::string, 2>& edges,
                                        const std::string& label);

}  // namespace faultline

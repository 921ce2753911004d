#pragma once

#include <string>

#include "tools/dashboard/live_view.h"

namespace faultline {

/// Of a terminal, in characters.
struct TerminalSize {
  int columns = 80;
  int rows = 24;
};

/// The view as one screenful for a terminal with ANSI sequences: verdict, a bar per residual
/// against its threshold (at three quarters of the bar's length), frames, drops and latency. No
/// line is longer than the terminal is wide, nor are there more than it has; residuals without room
/// are counted. What came from outside is stripped of control characters.
[[nodiscard]] std::string terminal_picture(const LiveView& view, TerminalSize size,
                                           const std::string& url, LiveView::Clock::time_point now);

/// The same in one plain line, without its end.
[[nodiscard]] std::string terminal_line(const LiveView& view, const std::string& url,
                                        LiveView::Clock::time_point now);

}  // namespace faultline

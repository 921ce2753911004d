#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/can/can_frame.h"
#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// What of a log is played, and as what.
struct PlaybackSelection {
  std::string log;
  bool is_as_messages = false;        ///< to LCM; else frames to buses
  std::vector<std::string> channels;  ///< LCM: only these; empty: all
  /// Short names of the buses to play to ("vcan0"): a candump log whose buses all have one of these
  /// names goes there by name, else in the order in which they appear.
  std::vector<std::string> buses;
  double from_s = 0.0;  ///< since the begin of the log
  std::optional<double> to_s;
  std::shared_ptr<const DbcDatabase> dbc;  ///< for a CSV of signals
};

/// What reading a log through has shown.
struct PlaybackOutline {
  std::int64_t duration_ns = 0;  ///< of the whole log
  // Of the part that is played:
  std::uint64_t units = 0;         ///< frames, or messages
  std::uint64_t groups = 0;        ///< units with one stamp together
  std::int64_t last_ns = 0;        ///< of the last group, since the begin of the log
  std::uint64_t backwards = 0;     ///< units whose stamp lies before the one before: sent at once
  std::uint64_t error_frames = 0;  ///< made by a controller: no bus takes them
  std::map<std::string, std::uint64_t> channels;  ///< messages of the whole log
  std::vector<std::string> buses;  ///< of the frames, by index; empty: none of that index
};

/// What reading for playback calls, in the order of the log. Times are since its begin and never
/// decrease. @return false: enough.
struct PlaybackReceiver {
  std::function<bool(std::int64_t at_ns, const CanFrame& frame)> on_frame;
  /// `channel` is NUL-terminated behind its end.
  std::function<bool(std::int64_t at_ns, std::string_view channel,
                     std::span<const std::uint8_t> data)>
      on_message;
};

/// A log to be played: an LCM log, a candump log, a CSV of signals.
class PlaybackLog {
 public:
  /// Reads it through once, and checks that there is something to play.
  /// @param on_problem what was passed over
  /// @throws std::invalid_argument, FrameLogError it is no such log, or has nothing of what was
  ///   selected: what was found and expected; std::system_error it cannot be read.
  PlaybackLog(PlaybackSelection selection,
              const std::function<void(const std::string&)>& on_problem);

  [[nodiscard]] const PlaybackSelection& selection() const noexcept { return selection_; }
  [[nodiscard]] const PlaybackOutline& outline() const noexcept { return outline_; }
  /// From where the next pass of a loop begins: the part's length, and where it has no given end
  /// the mean distance of its groups more.
  [[nodiscard]] std::int64_t period_ns() const noexcept;
  [[nodiscard]] std::int64_t from_ns() const noexcept { return from_ns_; }

  /// Reads the part to be played. Messages: FAULTLINE_RUN before its begin comes too, at its begin:
  /// without it nobody could read the rest. @throws std::system_error.
  void read(const PlaybackReceiver& receiver) const;

 private:
  class Clock;
  struct Pass;
  void read_messages(Pass& pass) const;
  void read_frames(Pass& pass) const;
  [[nodiscard]] bool is_selected(std::string_view channel) const;
  [[nodiscard]] std::uint8_t bus_index(std::string_view bus) const;
  void map_buses();
  void check_selection() const;
  void check_channels() const;

  PlaybackSelection selection_;
  bool is_lcm_log_ = false;
  std::int64_t from_ns_ = 0, to_ns_ = 0;
  PlaybackOutline outline_;
};

}  // namespace faultline

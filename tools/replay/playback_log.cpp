#include "tools/replay/playback_log.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"
#include "tools/can/frame_log.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/log_reader.h"
#include "tools/replay/frame_messages.h"

namespace faultline {
namespace {

constexpr std::int64_t kNanosecondsPerMicrosecond = 1000;
/// A stamp that lies further back than this is no disorder: the clock was set back.
constexpr std::int64_t kClockSetBack_ns = 1'000'000'000;
/// Times of an LCM log and of frames are within this, some 146 years: far from overflow.
constexpr std::int64_t kLargestTime_ns = std::numeric_limits<std::int64_t>::max() / 2;

/// Unwinds a reader that calls back, when enough has been read.
struct Enough {};

bool begins_with_lcm_magic(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  std::string head(kLogMagic.size(), '\0');
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  return head == kLogMagic;
}

std::int64_t to_ns(double seconds) {
  constexpr double kNanosecondsPerSecond = 1e9;
  const double ns = seconds * kNanosecondsPerSecond;
  return ns < static_cast<double>(kLargestTime_ns) ? std::llround(ns) : kLargestTime_ns;
}

double to_s(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

}  // namespace

/// Stamps to times since the begin of the log that never decrease. A stamp that lies a little
/// before the one before counts as that; one far before is a clock that was set back, and from
/// there on the distances count.
class PlaybackLog::Clock {
 public:
  /// The log's first stamp, played or not.
  void begin(std::int64_t stamp_ns) noexcept {
    if (!base_) base_ = stamp_ns;
  }
  std::int64_t at(std::int64_t stamp_ns) noexcept {
    begin(stamp_ns);
    // A stamp from outside may be anything.
    std::int64_t at_ns = 0;
    if (__builtin_sub_overflow(stamp_ns, *base_, &at_ns)) {
      at_ns = stamp_ns > 0 ? kLargestTime_ns : -kLargestTime_ns;
    }
    at_ns = std::clamp(at_ns, -kLargestTime_ns, kLargestTime_ns);
    is_backwards_ = at_ns < last_ns_;
    if (is_backwards_) {
      if (last_ns_ - at_ns > kClockSetBack_ns) {
        static_cast<void>(__builtin_sub_overflow(stamp_ns, last_ns_, &*base_));
      }
      at_ns = last_ns_;
    }
    last_ns_ = at_ns;
    return at_ns;
  }
  [[nodiscard]] bool is_backwards() const noexcept { return is_backwards_; }
  [[nodiscard]] std::int64_t last_ns() const noexcept { return last_ns_; }

 private:
  std::optional<std::int64_t> base_;
  std::int64_t last_ns_ = 0;
  bool is_backwards_ = false;
};

/// One reading of the log: of all of it when it is outlined, else of the part to be played.
struct PlaybackLog::Pass {
  const PlaybackReceiver& receiver;
  std::function<void(const std::string&)> on_problem = [](const std::string&) {};
  PlaybackOutline* outline = nullptr;  ///< to fill in; the reading goes to the log's end then
  Clock clock{};
  std::int64_t last_group_ns = -1;

  /// @return false: behind the part to be played.
  void note(std::int64_t at_ns) {
    if (outline == nullptr) return;
    ++outline->units;
    if (at_ns != last_group_ns) ++outline->groups;
    if (clock.is_backwards()) ++outline->backwards;
    last_group_ns = outline->last_ns = at_ns;
  }
};

PlaybackLog::PlaybackLog(PlaybackSelection selection,
                         const std::function<void(const std::string&)>& on_problem)
    : selection_(std::move(selection)),
      is_lcm_log_(begins_with_lcm_magic(selection_.log)),
      from_ns_(to_ns(selection_.from_s)),
      to_ns_(selection_.to_s ? to_ns(*selection_.to_s) : kLargestTime_ns) {
  if (selection_.log == "-") {
    throw std::invalid_argument("LOG: found - (stdin), expected a file: it is read more than once");
  }
  const PlaybackReceiver nobody{.on_frame = [](std::int64_t, const CanFrame&) { return true; },
                                .on_message = [](std::int64_t, std::string_view,
                                                 std::span<const std::uint8_t>) { return true; }};
  Pass pass{.receiver = nobody, .on_problem = on_problem, .outline = &outline_};
  // A message of an LCM log is played as it is; everything else is frames first.
  if (is_lcm_log_ && selection_.is_as_messages) {
    read_messages(pass);
  } else {
    read_frames(pass);
  }
  outline_.duration_ns = pass.clock.last_ns();
  map_buses();
  check_selection();
}

bool PlaybackLog::is_selected(std::string_view channel) const {
  return selection_.channels.empty() ||
         std::find(selection_.channels.begin(), selection_.channels.end(), channel) !=
             selection_.channels.end();
}

void PlaybackLog::read_messages(Pass& pass) const {
  LogReader log(selection_.log);
  std::size_t told_damages = 0;
  const auto tell_damages = [&] {
    for (; told_damages < log.damages().size(); ++told_damages) {
      pass.on_problem(describe(log.name(), log.damages()[told_damages]));
    }
  };
  std::string channel;  // with a NUL behind it, which the log does not have
  while (const LogEvent* event = log.next()) {
    tell_damages();
    std::int64_t stamp_ns = 0;
    if (__builtin_mul_overflow(event->utime, kNanosecondsPerMicrosecond, &stamp_ns)) continue;
    pass.clock.begin(stamp_ns);
    channel.assign(event->channel);
    if (pass.outline != nullptr) ++pass.outline->channels[channel];
    if (!is_selected(channel)) continue;
    std::int64_t at_ns = pass.clock.at(stamp_ns);
    if (at_ns < from_ns_) {
      if (channel != kRunChannel) continue;
      at_ns = from_ns_;
    }
    if (at_ns >= to_ns_) {
      if (pass.outline == nullptr) return;
      continue;
    }
    pass.note(at_ns);
    if (!pass.receiver.on_message(at_ns, channel, event->data)) return;
  }
  tell_damages();
}

void PlaybackLog::read_frames(Pass& pass) const {
  FrameMessages messages(pass.receiver.on_message);
  const auto on_frame = [&](const CanFrame& recorded, std::string_view bus) {
    CanFrame frame = recorded;
    if (pass.outline != nullptr) {
      std::vector<std::string>& buses = pass.outline->buses;
      if (is_lcm_log_) {
        if (buses.size() <= frame.bus) buses.resize(frame.bus + 1u);
        if (buses[frame.bus].empty()) buses[frame.bus] = bus;
      } else if (std::find(buses.begin(), buses.end(), bus) == buses.end()) {
        buses.emplace_back(bus);
      }
    }
    if (frame.is_error && !selection_.is_as_messages) {
      if (pass.outline != nullptr) ++pass.outline->error_frames;
      return;
    }
    const std::int64_t at_ns = pass.clock.at(frame.stamp.time_since_epoch().count());
    if (at_ns < from_ns_) return;
    if (at_ns >= to_ns_) {
      if (pass.outline == nullptr) throw Enough();
      return;
    }
    pass.note(at_ns);
    if (!is_lcm_log_) frame.bus = bus_index(bus);
    const bool goes_on = selection_.is_as_messages ? messages.add(at_ns, frame)
                                                   : pass.receiver.on_frame(at_ns, frame);
    if (!goes_on) throw Enough();
  };
  try {
    static_cast<void>(read_frame_log(
        selection_.log, selection_.dbc.get(),
        {.on_frame = on_frame, .on_problem = pass.on_problem, .on_remark = pass.on_problem}));
  } catch (const Enough&) {
  }
  messages.flush();
}

std::uint8_t PlaybackLog::bus_index(std::string_view bus) const {
  const auto found = std::find(outline_.buses.begin(), outline_.buses.end(), bus);
  return static_cast<std::uint8_t>(found - outline_.buses.begin());
}

/// A candump log's buses by their names, where all have one that is played to.
void PlaybackLog::map_buses() {
  const std::vector<std::string>& names = selection_.buses;
  if (is_lcm_log_ || outline_.buses.empty()) return;
  const bool are_all_known =
      std::all_of(outline_.buses.begin(), outline_.buses.end(), [&](const std::string& bus) {
        return std::find(names.begin(), names.end(), bus) != names.end();
      });
  if (are_all_known) outline_.buses = names;
}

void PlaybackLog::check_channels() const {
  std::vector<std::string> names;
  for (const auto& [name, count] : outline_.channels) names.push_back(name);
  for (const std::string& wanted : selection_.channels) {
    if (outline_.channels.contains(wanted)) continue;
    const auto near = nearest_name(wanted, names);
    throw std::invalid_argument(fmt::format("--channel: found {}, expected a channel of {} ({}){}",
                                            wanted, selection_.log, fmt::join(names, ", "),
                                            near ? fmt::format("; did you mean {}?", *near) : ""));
  }
}

void PlaybackLog::check_selection() const {
  if (is_lcm_log_ && selection_.is_as_messages) check_channels();
  const std::string& log = selection_.log;
  const bool has_any = selection_.is_as_messages
                           ? !outline_.channels.empty() || !outline_.buses.empty()
                           : !outline_.buses.empty();
  if (!has_any) {
    throw std::invalid_argument(fmt::format("{}: found no CAN frames{}, expected some to play", log,
                                            is_lcm_log_ ? fmt::format(" ({})", kCanChannel) : ""));
  }
  if (from_ns_ > outline_.duration_ns) {
    throw std::invalid_argument(
        fmt::format("--from: found {:g} s, expected less than {:.6g} s, the "
                    "length of {}",
                    selection_.from_s, to_s(outline_.duration_ns), log));
  }
  if (to_ns_ <= from_ns_) {
    throw std::invalid_argument(fmt::format("--to: found {:g} s, expected more than --from, {:g} s",
                                            *selection_.to_s, selection_.from_s));
  }
  if (outline_.units == 0) {
    throw std::invalid_argument(
        fmt::format("{}: found nothing between {:g} and {:g} s, expected something to play", log,
                    selection_.from_s, std::min(to_s(to_ns_), to_s(outline_.duration_ns))));
  }
  if (!selection_.is_as_messages && outline_.buses.size() > selection_.buses.size()) {
    const std::size_t missing = selection_.buses.size();
    throw std::invalid_argument(fmt::format(
        "--bus: found {} bus{}, expected {}: {} has frames of bus {} ({}) too; name one for each, "
        "e.g. can:can0,can:can1",
        missing, missing == 1 ? "" : "es", outline_.buses.size(), log, outline_.buses.size() - 1,
        outline_.buses.back()));
  }
}

std::int64_t PlaybackLog::period_ns() const noexcept {
  if (selection_.to_s) return to_ns_ - from_ns_;
  const std::int64_t length = outline_.last_ns - from_ns_;
  const auto intervals = static_cast<std::int64_t>(outline_.groups) - 1;
  return length + (intervals > 0 ? length / intervals : 0);
}

void PlaybackLog::read(const PlaybackReceiver& receiver) const {
  Pass pass{.receiver = receiver};
  if (is_lcm_log_ && selection_.is_as_messages) {
    read_messages(pass);
  } else {
    read_frames(pass);
  }
}

}  // namespace faultline

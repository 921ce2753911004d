#include "tools/log/log_cut.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <set>
#include <stdexcept>
#include <system_error>
#include <tuple>
#include <vector>

#include <faultline/run_t.hpp>
#include <fmt/format.h>

#include "tools/lcm/channels.h"
#include "tools/lcm/frame_message.h"
#include "tools/lcm/message_sink.h"
#include "tools/lcm/message_type.h"
#include "tools/log/channel_choice.h"
#include "tools/log/log_files.h"
#include "tools/log/replaced_file.h"

namespace faultline {
namespace {

constexpr std::int64_t kBeginning = std::numeric_limits<std::int64_t>::min();
constexpr std::int64_t kEnd = std::numeric_limits<std::int64_t>::max();

/// What is kept, in the log's own times.
struct Window {
  std::int64_t from_utime = kBeginning, to_utime = kEnd;
  std::optional<std::int64_t> from_cycle, to_cycle;

  [[nodiscard]] bool holds_cycle(std::int64_t cycle) const {
    return cycle >= from_cycle.value_or(kBeginning) && cycle < to_cycle.value_or(kEnd);
  }
};

/// `utime` and seconds later, as far as that can be counted.
std::int64_t later(std::int64_t utime, double seconds) {
  const double sum = static_cast<double>(utime) + seconds * 1e6;
  if (sum <= static_cast<double>(kBeginning)) return kBeginning;
  if (sum >= static_cast<double>(kEnd)) return kEnd;
  return utime + std::llround(seconds * 1e6);
}

/// Looks through the log: where the wanted cycles lie, and which channels there are.
Window find_window(const std::string& log, const LogCut& cut) {
  Window window;
  window.from_cycle = cut.from_cycle;
  window.to_cycle = cut.to_cycle;
  LogFiles events({log});
  std::set<std::string> channels;
  std::optional<std::int64_t> first_utime, first_cycle, last_cycle;
  const MessageType& sample = *find_message_type(kSampleChannel);
  while (const LogEvent* event = events.next()) {
    if (!first_utime) first_utime = event->utime;
    channels.emplace(event->channel);
    MessageHead head;
    if (event->channel != kSampleChannel ||
        read_head(sample, event->data, head) != MessageStatus::kWhole) {
      continue;
    }
    first_cycle = std::min(first_cycle.value_or(head.cycle), head.cycle);
    last_cycle = std::max(last_cycle.value_or(head.cycle), head.cycle);
    // The frames of a cycle come before its sample, and behind the sample before it.
    if (cut.from_cycle && head.cycle < *cut.from_cycle) {
      window.from_utime = std::max(window.from_utime, event->utime);
    }
    if (cut.to_cycle && head.cycle >= *cut.to_cycle) {
      window.to_utime = std::min(window.to_utime, event->utime);
    }
  }
  require_found(cut.channels, {channels.begin(), channels.end()}, log);
  if (!first_utime) throw std::invalid_argument(log + ": found no whole event, expected some");
  if (cut.from_s) window.from_utime = later(*first_utime, *cut.from_s);
  if (cut.to_s) window.to_utime = later(*first_utime, *cut.to_s);
  if (!cut.from_cycle && !cut.to_cycle) return window;
  const auto is_there = [&](std::int64_t from, std::int64_t to) {
    return first_cycle && from <= *last_cycle && to > *first_cycle;
  };
  if (!is_there(cut.from_cycle.value_or(kBeginning), cut.to_cycle.value_or(kEnd))) {
    throw std::invalid_argument(fmt::format(
        "{}: found {}, expected some of the cycles asked for", log,
        first_cycle ? fmt::format("samples of cycles {} to {}", *first_cycle, *last_cycle)
                    : "no samples"));
  }
  return window;
}

class Cutter {
 public:
  Cutter(const LogCut& cut, const Window& window, ReplacedFile& out)
      : cut_(cut), window_(window), out_(out) {}

  void take(const LogEvent& event) {
    if (event.channel == kRunChannel) {
      take_run(event);
    } else if (is_chosen(cut_.channels, event.channel) && is_inside(event)) {
      for (const auto& run : runs_before_) write(run);
      runs_before_.clear();
      write({event.bytes.begin(), event.bytes.end()});
      has_any_ = is_run_kept_ = true;
    }
  }

  [[nodiscard]] bool has_any() const noexcept { return has_any_; }
  [[nodiscard]] const LogCutResult& result() const noexcept { return result_; }

 private:
  /// RUN comes once, with the first event that is kept of its run. Where it came later (lcm-logger
  /// was started late) it stays there.
  void take_run(const LogEvent& event) {
    run_t run;
    if (!decode_message(event.data, layout::kRun, run)) return;
    if (run.run_id != run_id_) {
      // A log that begins late names its run later.
      if (!run_id_.empty()) {
        runs_before_.clear();
        known_.clear();
        is_run_kept_ = false;
      }
      run_id_ = run.run_id;
    }
    if (!known_.insert({run.part, run.digest, run.chunk}).second) return;
    if (is_run_kept_) {
      write({event.bytes.begin(), event.bytes.end()});
    } else {
      runs_before_.emplace_back(event.bytes.begin(), event.bytes.end());
    }
  }

  bool is_inside(const LogEvent& event) {
    const MessageType* const type = find_message_type(event.channel);
    MessageHead head;
    const bool is_whole =
        type != nullptr && read_head(*type, event.data, head) == MessageStatus::kWhole;
    if (is_whole && head.cycle >= 0 && (window_.from_cycle || window_.to_cycle)) {
      return window_.holds_cycle(head.cycle);
    }
    if (event.utime < window_.from_utime) return false;
    if (event.utime < window_.to_utime) return true;
    return is_whole && event.channel == kCanChannel && decode_frames(event.data, batch_) &&
           !batch_.frames.empty() &&
           std::chrono::floor<std::chrono::microseconds>(
               batch_.frames.front().stamp.time_since_epoch())
                   .count() < window_.to_utime;
  }

  void write(const std::vector<std::uint8_t>& bytes) {
    out_.write(bytes.data(), bytes.size());
    ++result_.events;
    result_.bytes += bytes.size();
  }

  const LogCut& cut_;
  const Window& window_;
  ReplacedFile& out_;
  std::string run_id_;
  std::vector<std::vector<std::uint8_t>> runs_before_;
  std::set<std::tuple<std::string, std::string, std::int32_t>> known_;
  FrameBatch batch_;
  bool has_any_ = false, is_run_kept_ = false;
  LogCutResult result_;
};

}  // namespace

LogCutResult cut_log(const std::string& log, const std::string& out, const LogCut& cut) {
  std::error_code error;
  if (std::filesystem::equivalent(log, out, error)) {
    throw std::invalid_argument(
        fmt::format("{}: found the same file as input and output, expected another", out));
  }
  const auto type = std::filesystem::status(out, error).type();
  if (type != std::filesystem::file_type::not_found &&
      type != std::filesystem::file_type::regular) {
    throw std::invalid_argument(
        fmt::format("{}: found no ordinary file, expected one or none", out));
  }
  require_replaceable(out);
  const Window window = find_window(log, cut);
  ReplacedFile file(out);
  Cutter cutter(cut, window, file);
  LogFiles events({log});
  while (const LogEvent* event = events.next()) cutter.take(*event);
  if (!cutter.has_any()) {
    throw std::invalid_argument(log + ": found no event between these times, expected some");
  }
  file.commit();
  LogCutResult result = cutter.result();
  result.damages = events.damages().size();
  return result;
}

}  // namespace faultline

#include "tools/log/log_check.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <utility>

#include <faultline/run_t.hpp>
#include <faultline/stats_t.hpp>

#include "tools/lcm/channels.h"
#include "tools/lcm/frame_message.h"
#include "tools/lcm/message_type.h"
#include "tools/lcm/run_parts.h"

namespace faultline {
namespace {

constexpr std::size_t kTypeCount = 9;

/// Follows one run through the log.
class RunFollower {
 public:
  [[nodiscard]] bool is_empty() const noexcept { return message_count_ == 0; }
  [[nodiscard]] bool has_ended() const noexcept { return stats_.is_final != 0; }
  /// Empty before the first RUN message.
  [[nodiscard]] const std::string& run_id() const noexcept { return parts_.run_id(); }

  void take(std::size_t type, const MessageHead& head, std::span<const std::uint8_t> data) {
    ++message_count_;
    Channel& channel = channels_[type];
    const bool is_new = channel.numbers.add(head.sequence);
    if (!is_new) ++channel.repeats;
    if (head.cycle >= 0) (type == sample_type_ ? sample_cycles_ : other_cycles_).take(head.cycle);
    if (type == run_type_ && !is_new) {
      const auto known = run_messages_.find(head.sequence);
      const bool is_same =
          known != run_messages_.end() &&
          std::equal(data.begin(), data.end(), known->second.begin(), known->second.end());
      if (!is_same) ++channel.differing_repeats;
    }
  }
  void take_run(const run_t& run, std::int64_t sequence, std::span<const std::uint8_t> data) {
    parts_.take(run);
    run_messages_.emplace(sequence, std::vector<std::uint8_t>(data.begin(), data.end()));
  }
  void take_frames(const FrameBatch& batch) {
    frames_.malformed += batch.malformed;
    if (batch.frame_count > 0) {
      frame_numbers_.add(batch.first_frame, batch.first_frame + batch.frame_count - 1);
    }
  }
  void take_stats(stats_t stats) {
    if (stats.sequence >= stats_.sequence) stats_ = std::move(stats);
  }

  [[nodiscard]] RunCheck finish() const {
    RunCheck check;
    check.run_id = run_id();
    const CycleSpan& cycles = sample_cycles_.first ? sample_cycles_ : other_cycles_;
    check.first_cycle = cycles.first;
    check.last_cycle = cycles.last;
    check.has_ended = has_ended();
    check.begins_late = begins_late();
    for (std::size_t type = 0; type < kTypeCount; ++type) {
      ChannelCheck channel = check_channel(type, check.begins_late);
      if (channel.logged > 0 || channel.published || !channel.missing.empty())
        check.channels.push_back(std::move(channel));
    }
    check.frames = frames_;
    check.frames.logged = frame_numbers_.count() - frames_.malformed;
    if (!frame_numbers_.is_empty()) {
      check.frames.missing = frame_numbers_.gaps(check.begins_late ? frame_numbers_.smallest() : 0,
                                                 frame_numbers_.largest() + 1);
    }
    if (has_stats()) {
      check.frames.unlogged = stats_.frames_unlogged;
      check.records_dropped = stats_.records_dropped;
      check.frames_dropped = stats_.frames_dropped;
    }
    for (const RunParts::Part& part : parts_.parts()) {
      check.parts.push_back({part.part, part.name, part.is_whole()});
    }
    return check;
  }

 private:
  struct Channel {
    NumberRanges numbers;
    std::uint64_t repeats = 0, differing_repeats = 0;
  };
  struct CycleSpan {
    std::optional<std::int64_t> first, last;
    void take(std::int64_t cycle) {
      first = std::min(first.value_or(cycle), cycle);
      last = std::max(last.value_or(cycle), cycle);
    }
  };

  static constexpr std::int64_t kNoNumber = std::numeric_limits<std::int64_t>::max();

  [[nodiscard]] bool has_stats() const noexcept { return stats_.sequence >= 0; }

  /// The channels on which the first cycle has a message tell; where a log holds none of them, all
  /// but RUN, which is repeated for those who come late.
  [[nodiscard]] bool begins_late() const {
    constexpr std::string_view kFromTheFirst =
        "FAULTLINE_CAN FAULTLINE_SAMPLE FAULTLINE_RESIDUAL "
        "FAULTLINE_TRUTH FAULTLINE_STATS";
    std::int64_t smallest = kNoNumber, smallest_of_others = kNoNumber;
    for (std::size_t type = 0; type < kTypeCount; ++type) {
      const NumberRanges& numbers = channels_[type].numbers;
      if (type == run_type_ || numbers.is_empty()) continue;
      const bool is_regular =
          kFromTheFirst.find(message_types()[type].channel) != std::string_view::npos;
      std::int64_t& found = is_regular ? smallest : smallest_of_others;
      found = std::min(found, numbers.smallest());
    }
    const std::int64_t first = smallest != kNoNumber ? smallest : smallest_of_others;
    return first != 0 && first != kNoNumber;
  }

  [[nodiscard]] std::optional<std::int64_t> published(std::string_view channel) const {
    for (std::size_t i = 0; has_stats() && i < stats_.channel.size(); ++i) {
      if (stats_.channel[i] == channel && stats_.published[i] >= 0) return stats_.published[i];
    }
    return std::nullopt;
  }

  [[nodiscard]] ChannelCheck check_channel(std::size_t type, bool begins_late) const {
    const Channel& channel = channels_[type];
    const NumberRanges& numbers = channel.numbers;
    ChannelCheck check;
    check.channel = message_types()[type].channel;
    check.logged = numbers.count();
    check.repeats = channel.repeats;
    check.differing_repeats = channel.differing_repeats;
    check.published = published(check.channel);
    // Before the end the last STATS is behind.
    const std::int64_t counted = check.published.value_or(0);
    std::int64_t first = 0;
    std::int64_t end = counted;
    if (!numbers.is_empty()) {
      if (begins_late && type != run_type_) first = numbers.smallest();
      end = has_ended() ? counted : std::max(counted, numbers.largest() + 1);
      if (has_ended()) {
        check.beyond = numbers.count() + count_of(numbers.gaps(0, counted)) -
                       static_cast<std::uint64_t>(counted);
      }
    } else if (begins_late) {
      end = 0;  // nobody knows whether any came since the log begins
    }
    check.missing = numbers.gaps(first, end);
    if (!has_ended()) check.published.reset();
    return check;
  }

  static std::size_t index_of(std::string_view channel) {
    const auto types = message_types();
    return static_cast<std::size_t>(find_message_type(channel) - types.data());
  }

  std::size_t run_type_ = index_of(kRunChannel), sample_type_ = index_of(kSampleChannel);
  std::uint64_t message_count_ = 0;
  std::array<Channel, kTypeCount> channels_;
  std::map<std::int64_t, std::vector<std::uint8_t>> run_messages_;
  RunParts parts_;
  FrameCheck frames_;
  NumberRanges frame_numbers_;
  CycleSpan sample_cycles_, other_cycles_;
  stats_t stats_ = no_stats();

  static stats_t no_stats() {
    stats_t stats{};
    stats.sequence = -1;
    return stats;
  }
};

class Checker {
 public:
  void take(const LogEvent& event, bool is_first_of_file) {
    ++check_.events;
    // Every file is numbered from 0, unless it was cut out of another.
    const std::int64_t expected = is_first_of_file ? 0 : last_number_ + 1;
    if (event.number >= 0 && event.number < kLargestNumber) {
      if (event.number > expected) {
        check_.missing_events += static_cast<std::uint64_t>(event.number - expected);
      }
      last_number_ = event.number;
    }

    const MessageType* const type = find_message_type(event.channel);
    if (type == nullptr) {
      ++check_.other_channels[std::string(event.channel)];
      return;
    }
    MessageHead head;
    const MessageStatus status = read_head(*type, event.data, head);
    if (status == MessageStatus::kOtherSchema) ++check_.other_schema[std::string(type->name)];
    if (status == MessageStatus::kDamaged) ++check_.undecodable[std::string(type->name)];
    if (status == MessageStatus::kWhole) take_whole(*type, head, event.data);
  }

  LogCheck finish(const LogFiles& files) {
    finish_run();
    check_.damages = files.damages();
    return std::move(check_);
  }

 private:
  void take_whole(const MessageType& type, const MessageHead& head,
                  std::span<const std::uint8_t> data) {
    const auto index = static_cast<std::size_t>(&type - message_types().data());
    if (type.channel == kRunChannel) {
      run_t run;
      if (!decode_message(data, layout::kRun, run)) return add_undecodable(type);
      if (run.byte_count == 0) run.data.clear();
      // Another run in the same log. A log that begins late knows a run's name only later.
      const bool is_other = run_.run_id().empty() ? run_.has_ended() : run.run_id != run_.run_id();
      if (is_other) finish_run();
      run_.take(index, head, data);
      run_.take_run(run, head.sequence, data);
      return;
    }
    if (type.channel == kCanChannel) {
      if (!decode_frames(data, batch_) || batch_.first_frame < 0 ||
          batch_.first_frame > kLargestNumber) {
        return add_undecodable(type);
      }
      run_.take_frames(batch_);
    }
    if (type.channel == kStatsChannel) {
      stats_t stats;
      if (!decode_message(data, layout::kStats, stats)) return add_undecodable(type);
      if (stats.channel_count == 0) stats.channel.clear();
      run_.take_stats(std::move(stats));
    }
    run_.take(index, head, data);
  }

  void add_undecodable(const MessageType& type) { ++check_.undecodable[std::string(type.name)]; }

  void finish_run() {
    if (!run_.is_empty()) check_.runs.push_back(run_.finish());
    run_ = RunFollower();
  }

  /// Nobody counts so far: a number beyond is damage, and counting on from it must not overflow.
  static constexpr std::int64_t kLargestNumber = std::int64_t{1} << 62;

  LogCheck check_;
  std::int64_t last_number_ = -1;
  RunFollower run_;
  FrameBatch batch_;
};

}  // namespace

bool ChannelCheck::is_complete() const {
  const bool has_false_repeats = channel == kRunChannel ? differing_repeats > 0 : repeats > 0;
  return missing.empty() && beyond == 0 && !has_false_repeats;
}

bool RunCheck::has_no_gaps() const {
  const bool are_channels_complete =
      std::all_of(channels.begin(), channels.end(),
                  [](const ChannelCheck& channel) { return channel.is_complete(); });
  const bool are_parts_whole =
      std::all_of(parts.begin(), parts.end(), [](const Part& part) { return part.is_whole; });
  return are_channels_complete && are_parts_whole && !parts.empty() && frames.missing.empty() &&
         frames.malformed == 0 && frames.unlogged.value_or(0) == 0 && records_dropped == 0;
}

bool LogCheck::is_complete() const {
  if (!damages.empty() || !other_schema.empty() || !undecodable.empty()) return false;
  if (runs.empty()) return missing_events == 0;
  return std::all_of(runs.begin(), runs.end(),
                     [](const RunCheck& run) { return run.is_complete(); });
}

LogCheck check_log(const std::vector<std::string>& files) {
  LogFiles log(files);
  Checker checker;
  std::size_t file_index = files.size();
  while (const LogEvent* event = log.next()) {
    checker.take(*event, log.file_index() != file_index);
    file_index = log.file_index();
  }
  return checker.finish(log);
}

}  // namespace faultline

#include "tools/log/log_info.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include <faultline/diagnosis_t.hpp>
#include <faultline/estimate_t.hpp>
#include <faultline/run_t.hpp>

#include "tools/lcm/channels.h"
#include "tools/lcm/message_type.h"
#include "tools/lcm/run_parts.h"

namespace faultline {
namespace {

class InfoReader {
 public:
  void take(const LogEvent& event) {
    if (info_.messages++ == 0) info_.first_utime = event.utime;
    info_.duration_s = std::max(info_.duration_s, time_of(event.utime));
    LogInfo::Channel& channel = info_.channels[std::string(event.channel)];
    ++channel.messages;
    channel.bytes += event.data.size();
    const MessageType* const type = find_message_type(event.channel);
    if (type == nullptr) return;
    MessageHead head;
    if (read_head(*type, event.data, head) != MessageStatus::kWhole ||
        !take_message(*type, head, event)) {
      ++info_.undecodable;
      return;
    }
    const auto expected = next_sequence_.find(event.channel);
    if (expected != next_sequence_.end() && head.sequence > expected->second) {
      channel.missing += static_cast<std::uint64_t>(head.sequence - expected->second);
    }
    next_sequence_[std::string(event.channel)] = head.sequence + 1;
  }

  LogInfo finish(const LogFiles& files) {
    for (const RunParts::Part& part : parts_.parts()) {
      info_.parts.push_back({part.part, part.name, part.digest, part.is_whole()});
    }
    info_.run_id = parts_.run_id();
    info_.damages = files.damages();
    return std::move(info_);
  }

 private:
  [[nodiscard]] double time_of(std::int64_t utime) const {
    return (static_cast<double>(utime) - static_cast<double>(info_.first_utime)) / 1e6;
  }

  /// @return false if it cannot be decoded.
  bool take_message(const MessageType& type, const MessageHead& head, const LogEvent& event) {
    if (type.channel == kRunChannel) {
      run_t run;
      if (!decode_message(event.data, type.layout, run)) return false;
      if (parts_.take(run)) next_sequence_.clear();  // another run counts anew
    } else if (type.channel == kDiagnosisChannel) {
      diagnosis_t diagnosis;
      if (!decode_message(event.data, type.layout, diagnosis)) return false;
      take_diagnosis(diagnosis, event.utime);
    } else if (type.channel == kEstimateChannel) {
      estimate_t estimate;
      if (!decode_message(event.data, type.layout, estimate)) return false;
      take_estimate(estimate);
    } else if (type.channel == kStatsChannel) {
      stats_t stats;
      if (!decode_message(event.data, type.layout, stats)) return false;
      info_.stats = std::move(stats);
    } else if (type.channel == kSampleChannel && head.cycle >= 0) {
      info_.first_cycle = std::min(info_.first_cycle.value_or(head.cycle), head.cycle);
      info_.last_cycle = std::max(info_.last_cycle.value_or(head.cycle), head.cycle);
    }
    return true;
  }

  void take_diagnosis(const diagnosis_t& diagnosis, std::int64_t utime) {
    std::vector<std::vector<std::string>> sets;
    for (const fault_set_t& set : diagnosis.sets) sets.push_back(set.faults);
    if (!info_.verdicts.empty() && info_.verdicts.back().verdict == diagnosis.verdict &&
        info_.verdicts.back().sets == sets) {
      info_.verdicts.back().cause = diagnosis.cause;
      if (info_.verdicts.back().blame.empty()) info_.verdicts.back().blame = diagnosis.blame;
      return;
    }
    info_.verdicts.push_back({diagnosis.cycle,
                              time_of(utime),
                              diagnosis.verdict,
                              diagnosis.cause,
                              diagnosis.onset_cycle,
                              std::move(sets),
                              {},
                              diagnosis.blame});
  }

  // Of the verdict before it. One without values does not unsay the last.
  void take_estimate(const estimate_t& estimate) {
    if (info_.verdicts.empty() || estimate.fault_count == 0) return;
    LogInfo::VerdictChange& change = info_.verdicts.back();
    change.onset_cycle = estimate.onset_cycle;
    change.estimates.clear();
    for (std::size_t i = 0; i < estimate.fault.size(); ++i) {
      change.estimates.push_back({estimate.fault[i], estimate.estimate[i], estimate.deviation[i]});
    }
  }

  LogInfo info_;
  std::map<std::string, std::int64_t, std::less<>> next_sequence_;
  RunParts parts_;
};

}  // namespace

LogInfo read_log_info(const std::vector<std::string>& files) {
  LogFiles log(files);
  InfoReader reader;
  while (const LogEvent* event = log.next()) reader.take(*event);
  return reader.finish(log);
}

}  // namespace faultline

#include "tools/log/log_info.h"

#include <cstdint>
#include <set>
#include <string_view>

#include <faultline/can_t.hpp>
#include <faultline/diagnosis_t.hpp>
#include <faultline/estimate_t.hpp>
#include <faultline/event_t.hpp>
#include <faultline/residual_t.hpp>
#include <faultline/run_t.hpp>
#include <faultline/sample_t.hpp>
#include <faultline/stats_t.hpp>
#include <faultline/truth_t.hpp>
#include <fmt/format.h>

#include "tools/lcm/channels.h"
#include "tools/lcm/log_reader.h"

namespace faultline {
namespace {

class InfoReader {
 public:
  void take(const LogEvent& event) {
    if (info_.messages++ == 0) first_utime_ = event.utime;
    info_.duration_s = static_cast<double>(event.utime - first_utime_) * 1e-6;
    LogInfo::Channel& channel = info_.channels[std::string(event.channel)];
    ++channel.messages;
    channel.bytes += event.data.size();
    if (event.channel == kRunChannel) {
      take_as<run_t>(event, layout::kRun, channel, [this](const run_t& run) { take_run(run); });
    } else if (event.channel == kDiagnosisChannel) {
      take_as<diagnosis_t>(
          event, layout::kDiagnosis, channel,
          [this, &event](const diagnosis_t& diagnosis) { take_diagnosis(diagnosis, event.utime); });
    } else if (event.channel == kEstimateChannel) {
      take_as<estimate_t>(event, layout::kEstimate, channel,
                          [this](const estimate_t& estimate) { take_estimate(estimate); });
    } else if (event.channel == kCanChannel) {
      take_as<can_t>(event, layout::kCan, channel, [](const can_t&) {});
    } else if (event.channel == kSampleChannel) {
      take_as<sample_t>(event, layout::kSample, channel, [](const sample_t&) {});
    } else if (event.channel == kResidualChannel) {
      take_as<residual_t>(event, layout::kResidual, channel, [](const residual_t&) {});
    } else if (event.channel == kTruthChannel) {
      take_as<truth_t>(event, layout::kTruth, channel, [](const truth_t&) {});
    } else if (event.channel == kEventChannel) {
      take_as<event_t>(event, layout::kEvent, channel, [](const event_t&) {});
    } else if (event.channel == kStatsChannel) {
      take_as<stats_t>(event, layout::kStats, channel, [](const stats_t&) {});
    }
  }

  LogInfo finish() {
    for (LogInfo::Part& part : info_.parts) {
      part.is_complete =
          static_cast<std::int32_t>(chunks_[part.part].size()) == chunk_counts_[part.part];
    }
    return std::move(info_);
  }

 private:
  template <class Message, class Action>
  void take_as(const LogEvent& event, std::string_view layout, LogInfo::Channel& channel,
               const Action& action) {
    Message message;
    if (!decode_message(event.data, layout, message)) {
      ++info_.undecodable;
      return;
    }
    const auto expected = next_sequence_.find(event.channel);
    if (expected != next_sequence_.end() && message.sequence > expected->second) {
      channel.missing += static_cast<std::uint64_t>(message.sequence - expected->second);
    }
    next_sequence_[std::string(event.channel)] = message.sequence + 1;
    action(message);
  }

  void take_run(const run_t& run) {
    if (chunks_.find(run.part) == chunks_.end()) {
      info_.parts.push_back({run.part, run.name, run.digest, false});
      chunk_counts_[run.part] = run.chunk_count;
    }
    chunks_[run.part].insert(run.chunk);
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
                              static_cast<double>(utime - first_utime_) * 1e-6,
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
  std::int64_t first_utime_ = 0;
  std::map<std::string, std::int64_t, std::less<>> next_sequence_;
  std::map<std::string, std::set<std::int32_t>> chunks_;
  std::map<std::string, std::int32_t> chunk_counts_;
};

}  // namespace

LogInfo read_log_info(const std::filesystem::path& file) {
  LogReader log(file);
  InfoReader reader;
  while (const LogEvent* event = log.next()) reader.take(*event);
  LogInfo info = reader.finish();
  info.damages = log.damages();
  return info;
}

}  // namespace faultline

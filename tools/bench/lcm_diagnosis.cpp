#include "tools/bench/lcm_diagnosis.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/bank/bank_file.h"
#include "tools/bench/bench_inputs.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/log_event.h"

namespace faultline {
namespace {

/// Without these there is no diagnosis. Those of a scenario come in the same burst.
bool are_enough(const RunParts& parts) {
  const auto is_whole = [&parts](std::string_view name) {
    const RunParts::Part* const part = parts.find(name);
    return part != nullptr && part->is_whole();
  };
  const bool has_scenario = parts.find("scenario") != nullptr;
  return is_whole("bank") && is_whole("dbc") &&
         (!has_scenario ||
          (is_whole("scenario") && is_whole("plant") && has_all_includes(parts.whole_parts())));
}

/// @pre are_enough

}  // namespace

LcmDiagnosis::LcmDiagnosis(Options options)
    : options_(std::move(options)),
      sequence_({.on_batch = [this](const FrameBatch& batch) { on_batch(batch); },
                 .on_gap = [this](const FrameGap& gap) { on_gap(gap); },
                 .on_restart = [this] { on_restart(); }}),
      inputs_(options_.given) {}

void LcmDiagnosis::on_message(const LiveMessage& message) {
  if (message.channel == kRunChannel) {
    if (decode_message(message.data, layout::kRun, run_)) {
      on_run(run_);
    } else {
      ++undecodable_;
    }
  } else if (message.channel == kCanChannel) {
    if (decode_frames(message.data, batch_)) {
      sequence_.push(batch_);
    } else {
      ++undecodable_;
    }
  } else if (message.channel == kStatsChannel) {
    if (decode_message(message.data, layout::kStats, stats_)) {
      on_stats();
    } else {
      ++undecodable_;
    }
  }
}

void LcmDiagnosis::on_run(const run_t& chunk) {
  const bool is_other_run = parts_.take(chunk);
  if (is_other_run) {
    // The frames of the run before are all here: LCM keeps the order of what one sender sends.
    sequence_.give_up();
    sequence_.start_over();
    end_diagnosis();
    kept_.clear();
    kept_frames_ = 0;
    options_.tell(fmt::format("another run ({}): starting over", chunk.run_id));
    inputs_ = options_.given;
  }
  if (inputs_ || !are_enough(parts_)) return;
  inputs_ = bench_inputs_of_parts(parts_.whole_parts(), options_.source);
  // All parts of the run, once its frames begin.
  options_.tell(fmt::format("diagnosing {}", inputs_->name));
}

void LcmDiagnosis::on_stats() {
  // lcm-gen's decoder leaves arrays alone whose count is zero.
  if (stats_.is_final == 0 || stats_.channel_count <= 0) return;
  const auto found = std::find(stats_.channel.begin(), stats_.channel.end(), kCanChannel);
  if (found == stats_.channel.end()) return;
  sequence_.announce_end(
      stats_.published[static_cast<std::size_t>(found - stats_.channel.begin())]);
}

void LcmDiagnosis::on_batch(const FrameBatch& batch) {
  if (inputs_) {
    diagnose(batch);
  } else {
    keep(batch);
  }
}

void LcmDiagnosis::keep(const FrameBatch& batch) {
  if (batch.frames.empty()) return;
  kept_.push_back(batch);
  kept_frames_ += batch.frames.size();
  while (kept_frames_ > kMostKept) {
    kept_frames_ -= kept_.front().frames.size();
    forgotten_frames_ += kept_.front().frames.size();
    kept_.pop_front();
  }
}

void LcmDiagnosis::diagnose(const FrameBatch& batch) {
  std::deque<FrameBatch> batches = std::exchange(kept_, {});
  kept_frames_ = 0;
  batches.push_back(batch);
  for (const FrameBatch& next : batches) {
    if (next.frames.empty()) continue;
    if (!diagnosis_) {
      // The parts may have grown since they were enough: a list of buses comes last.
      if (!options_.given) {
        inputs_ = bench_inputs_of_parts(parts_.whole_parts(), options_.source);
      }
      diagnosis_ = std::make_unique<LiveDiagnosis>(*inputs_, options_.open_output(),
                                                   static_cast<std::uint64_t>(next.first_frame));
    }
    auto number = static_cast<std::uint64_t>(next.first_frame);
    for (const CanFrame& frame : next.frames) diagnosis_->on_frame(frame, number++);
  }
}

void LcmDiagnosis::on_gap(const FrameGap& gap) {
  std::string text;
  if (gap.lost_messages == 0) {
    text = fmt::format("{} frames are missing from number {} on: dropped before they were sent",
                       gap.frames, gap.first_frame);
  } else {
    const std::string frames =
        gap.frames > 0 ? fmt::format("with {} frames", gap.frames) : "at the end of the run";
    text = fmt::format("{} messages lost on {} {}, from number {} on", gap.lost_messages,
                       options_.source, frames, gap.first_frame);
  }
  options_.tell(text);
  if (diagnosis_ && gap.lost_messages > 0) diagnosis_->tell("warning", "diagnose", text);
}

void LcmDiagnosis::on_restart() {
  options_.tell("the numbers of the frames begin again (a playback in a loop?): starting over");
  end_diagnosis();
  kept_.clear();
  kept_frames_ = 0;
}

void LcmDiagnosis::end_diagnosis() {
  if (!diagnosis_) return;
  diagnosis_->finish();
  const std::unique_ptr<LiveDiagnosis> ended = std::exchange(diagnosis_, nullptr);
  options_.on_end(*ended);
}

void LcmDiagnosis::attend() {
  const auto now = std::chrono::steady_clock::now();
  if (!sequence_.is_waiting()) {
    complete_until_ = now;
  } else if (now - complete_until_ > kPatience) {
    sequence_.give_up();
  }
  if (diagnosis_) diagnosis_->attend();
}

void LcmDiagnosis::finish() {
  sequence_.give_up();
  end_diagnosis();
}

}  // namespace faultline

#include "tools/bench/live_diagnosis.h"

#include <utility>

#include <fmt/format.h>

#include "tools/lcm/frame_message.h"

namespace faultline {
namespace {

using std::chrono::steady_clock;

/// As in a bench's run (docs/design.md).
constexpr auto kRepeatPeriod = std::chrono::seconds(5);
constexpr std::int64_t kStatsPeriod_us = 1'000'000;

}  // namespace

LiveDiagnosis::LiveDiagnosis(DiagnosisInputs inputs, LiveDiagnosisOutput output,
                             std::uint64_t first_frame)
    : inputs_(std::move(inputs)),
      output_(std::move(output)),
      node_(inputs_.map, inputs_.bank, inputs_.is_initial_state_known && first_frame == 0),
      publisher_(inputs_, node_.decision_table().sets(), std::move(output_.log),
                 std::move(output_.live)),
      history_(inputs_.bank, node_.decision_table().sets(), no_scenario_, no_faults_),
      next_repeat_(steady_clock::now() + kRepeatPeriod) {}

template <class Action>
void LiveDiagnosis::guard(const Action& action) noexcept {
  if (error_) return;
  try {
    action();
  } catch (...) {
    error_ = std::current_exception();
  }
}

void LiveDiagnosis::rethrow() {
  if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
}

void LiveDiagnosis::begin(const CanFrame& frame, std::uint64_t number) {
  is_begun_ = true;
  utime_ = to_utime(frame.stamp);
  next_stats_utime_ = utime_ + kStatsPeriod_us;
  publisher_.publish_parts(utime_);
  tell("info", "diagnose", fmt::format("diagnosis of {}", inputs_.name));
  if (number > 0) {
    tell("info", "diagnose",
         fmt::format("listening began at frame {}: nothing is known of those before", number));
  }
}

void LiveDiagnosis::on_frame(const CanFrame& frame, std::uint64_t number) {
  if (!is_begun_) {
    begin(frame, number);
  } else if (number > number_ + 1) {
    const std::uint64_t missing = number - number_ - 1;
    counters_.frames_dropped += missing;
    tell("warning", "diagnose",
         fmt::format("{} frames are missing before number {}", missing, number));
  }
  number_ = number;
  utime_ = to_utime(frame.stamp);
  node_.on_frame(frame, *this);
  rethrow();
  if (utime_ < next_stats_utime_) return;
  next_stats_utime_ = utime_ + kStatsPeriod_us;
  publisher_.publish_stats(counters_, {}, cycle_, utime_, false);
}

void LiveDiagnosis::on_received(const CanFrame& frame) noexcept {
  ++counters_.frames_received;
  guard([&] { publisher_.add_frame(frame, number_, utime_); });
}

void LiveDiagnosis::on_record(const DiagnosisRecord& record) noexcept {
  guard([&] { follow(record); });
}

void LiveDiagnosis::follow(const DiagnosisRecord& record) {
  const std::int64_t utime = to_utime(record.stamp);
  const FaultEstimate* const estimate = publisher_.publish_record(record, utime);
  history_.on_record(record);
  if (estimate != nullptr) history_.on_estimate(*estimate);
  cycle_ = record.cycle;
  ++counters_.samples;
  if ((record.flags & kBadSample) != 0) ++counters_.bad_samples;
  if ((record.flags & kSampleReset) != 0) {
    ++counters_.resets;
    publisher_.publish_event(record.cycle, "warning", "diagnosis",
                             "restart or long gap on the bus: everything before is forgotten",
                             utime);
  }
  const VerdictEntry& verdict = history_.verdicts().back();
  const bool is_new = history_.verdicts().size() != verdicts_told_;
  const bool is_estimate_new = !verdict.estimates.empty() && (is_new || !is_estimate_told_);
  if (!is_new && !is_estimate_new) return;
  verdicts_told_ = history_.verdicts().size();
  is_estimate_told_ = is_estimate_new;
  output_.on_verdict(verdict);
}

void LiveDiagnosis::tell(const char* severity, const char* source, const std::string& text) {
  publisher_.publish_event(cycle_, severity, source, text, utime_);
}

void LiveDiagnosis::tell_now(const char* severity, const char* source, const std::string& text) {
  if (!is_begun_) return;
  const auto since_1970 = std::chrono::system_clock::now().time_since_epoch();
  const auto utime = std::chrono::duration_cast<std::chrono::microseconds>(since_1970).count();
  publisher_.publish_event(cycle_, severity, source, text, utime);
}

void LiveDiagnosis::attend() {
  if (!is_begun_) return;
  publisher_.flush_frames();
  publisher_.flush();
  const auto now = steady_clock::now();
  if (now < next_repeat_) return;
  next_repeat_ = now + kRepeatPeriod;
  publisher_.repeat_parts();
}

void LiveDiagnosis::finish() {
  node_.finish(*this);
  rethrow();
  publisher_.flush_frames();
  if (is_begun_) publisher_.publish_stats(counters_, {}, cycle_, utime_, true);
  publisher_.close();
}

}  // namespace faultline

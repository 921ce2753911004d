#include "tools/bench/run_publisher.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

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

#include "diagnosis/model/digest.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/frame_message.h"

namespace faultline {
namespace {

/// Payload bytes of one RUN chunk: with its header well below the 65,499 bytes of one datagram.
constexpr std::size_t kChunkBytes = 32768;
/// Frames of one CAN batch: 64 frames of 64 bytes and their headers make 5 kB.
constexpr std::size_t kFramesPerBatch = 64;
/// Cycles are counted in 32 bits.
constexpr double kMaxCyclesPerSecond = 4294967295.0;

std::int64_t signed_command_cycle(std::uint32_t command_cycle) {
  return command_cycle == kNoCommand ? -1 : static_cast<std::int64_t>(command_cycle);
}

/// A byte per channel; more than a byte holds is 255.
void copy_ages(const std::vector<std::uint32_t>& ages, std::vector<std::uint8_t>& out) {
  constexpr std::uint32_t kMost = 255;
  out.clear();
  for (const std::uint32_t age : ages)
    out.push_back(static_cast<std::uint8_t>(std::min(age, kMost)));
}

void copy_states(const std::vector<SignalState>& states, std::vector<std::uint8_t>& out) {
  out.clear();
  for (const SignalState state : states) out.push_back(static_cast<std::uint8_t>(state));
}

std::int64_t as_signed(std::uint64_t count) { return static_cast<std::int64_t>(count); }

latency_histogram_t to_message(const StageLatency& stage) {
  const LatencyHistogram& histogram = stage.histogram;
  latency_histogram_t message;
  message.stage = stage.stage;
  message.count = as_signed(histogram.count());
  message.min_ns = histogram.min().count();
  message.max_ns = histogram.max().count();
  message.corrected = as_signed(histogram.corrected());
  message.cycles_per_value = static_cast<std::int32_t>(stage.cycles_per_value);
  for (const LatencyHistogram::Bucket& bucket : histogram.buckets()) {
    message.upper_ns.push_back(bucket.upper.count());
    message.counts.push_back(as_signed(bucket.count));
  }
  message.bucket_count = static_cast<std::int32_t>(message.counts.size());
  return message;
}

/// Whether what such a fault does changes from cycle to cycle.
bool is_moving_kind(InjectionKind kind) {
  return kind == InjectionKind::kSinusoid || kind == InjectionKind::kDrift;
}

}  // namespace

/// A channel and how much was published on it.
struct RunPublisher::Channel {
  const char* name;
  std::int64_t next_sequence = 0;
};

/// One message per channel, reused so that publishing does not allocate once warm.
struct RunPublisher::Messages {
  run_t run;
  can_t can;
  sample_t sample;
  residual_t residual;
  diagnosis_t diagnosis;
  estimate_t estimate;
  truth_t truth;
  event_t event;
  stats_t stats;
  Channel on_run{kRunChannel}, on_can{kCanChannel}, on_sample{kSampleChannel},
      on_residual{kResidualChannel}, on_diagnosis{kDiagnosisChannel}, on_estimate{kEstimateChannel},
      on_truth{kTruthChannel}, on_event{kEventChannel}, on_stats{kStatsChannel};

  [[nodiscard]] std::array<const Channel*, 9> channels() const {
    return {&on_run,      &on_can,   &on_sample, &on_residual, &on_diagnosis,
            &on_estimate, &on_truth, &on_event,  &on_stats};
  }
};

RunPublisher::RunPublisher(const DiagnosisInputs& inputs,
                           std::vector<std::vector<std::size_t>> fault_sets,
                           std::unique_ptr<MessageSink> log, std::unique_ptr<MessageSink> live,
                           bool has_estimates)
    : inputs_(&inputs),
      fault_sets_(std::move(fault_sets)),
      log_(std::move(log)),
      live_(std::move(live)),
      messages_(std::make_unique<Messages>()),
      cycles_per_second_(static_cast<std::uint32_t>(
          std::clamp(std::round(1.0 / inputs.bank.sample_time_s), 1.0, kMaxCyclesPerSecond))) {
  if (has_estimates) estimator_.emplace(inputs);
  residual_t& residual = messages_->residual;
  sample_t& sample = messages_->sample;
  sample.output_count = static_cast<std::int32_t>(inputs.bank.output_names.size());
  sample.input_count = static_cast<std::int32_t>(inputs.bank.input_names.size());
  residual.row_count = static_cast<std::int32_t>(inputs.bank.residual_rows());
  residual.filter_count = static_cast<std::int32_t>(inputs.bank.filters.size());
  messages_->can.bus = 0;
  messages_->can.frames.reserve(kFramesPerBatch);
}

RunPublisher::~RunPublisher() = default;

template <class Message>
void RunPublisher::publish(Channel& channel, Message& message) {
  if (!has_sinks()) return;
  message.sequence = channel.next_sequence++;
  const auto size = static_cast<std::size_t>(message.getEncodedSize());
  if (buffer_.size() < size) buffer_.resize(size);
  message.encode(buffer_.data(), 0, static_cast<int>(size));
  const std::span<const std::uint8_t> encoded(buffer_.data(), size);
  if (log_) log_->publish(channel.name, message.utime, encoded);
  if (live_) live_->publish(channel.name, message.utime, encoded);
  ++message_count_;
}

void RunPublisher::publish_parts(std::int64_t utime) {
  if (!has_sinks()) return;
  run_id_ = text_digest(fmt::format("{} {}", inputs_->name, utime));
  parts_utime_ = utime;
  send_parts();
}

void RunPublisher::repeat_parts() {
  if (!live_) return;
  std::unique_ptr<MessageSink> log = std::exchange(log_, nullptr);
  const std::uint64_t message_count = message_count_;
  messages_->on_run.next_sequence = 0;
  send_parts();
  message_count_ = message_count;
  log_ = std::move(log);
}

void RunPublisher::send_parts() {
  run_t& run = messages_->run;
  run.run_id = run_id_;
  run.utime = parts_utime_;
  for (const RunPart& part : inputs_->parts) {
    run.part = part.part;
    run.name = part.name;
    run.digest = text_digest(part.text);
    const std::size_t chunk_count =
        std::max<std::size_t>(1, (part.text.size() + kChunkBytes - 1) / kChunkBytes);
    run.chunk_count = static_cast<std::int32_t>(chunk_count);
    for (std::size_t chunk = 0; chunk < chunk_count; ++chunk) {
      const std::string bytes = part.text.substr(chunk * kChunkBytes, kChunkBytes);
      run.chunk = static_cast<std::int32_t>(chunk);
      run.byte_count = static_cast<std::int32_t>(bytes.size());
      run.data.assign(bytes.begin(), bytes.end());
      publish(messages_->on_run, run);
    }
  }
}

void RunPublisher::add_frame(const CanFrame& frame, std::uint64_t number, std::int64_t utime) {
  if (!has_sinks()) return;
  can_t& can = messages_->can;
  if (can.frames.size() == kFramesPerBatch || can.bus != frame.bus || number != next_frame_) {
    flush_frames();
  }
  if (can.frames.empty()) can.first_frame = as_signed(number);
  next_frame_ = number + 1;
  can.bus = frame.bus;
  can.frames.push_back(to_message(frame));
  can.utime = utime;
}

void RunPublisher::flush_frames() {
  can_t& can = messages_->can;
  if (can.frames.empty()) return;
  can.frame_count = static_cast<std::int32_t>(can.frames.size());
  publish(messages_->on_can, can);
  can.frames.clear();
}

void RunPublisher::publish_sample(const DiagnosisRecord& record, std::int64_t utime) {
  sample_t& sample = messages_->sample;
  sample.utime = utime;
  sample.cycle = record.cycle;
  sample.command_cycle = signed_command_cycle(record.command_cycle);
  sample.flags = static_cast<std::int32_t>(record.flags);
  sample.y = record.y;
  sample.u = record.u;
  sample.y_is_fresh = record.y_is_fresh;
  sample.u_is_fresh = record.u_is_fresh;
  copy_states(record.y_state, sample.y_state);
  copy_states(record.u_state, sample.u_state);
  copy_ages(record.y_age, sample.y_age);
  copy_ages(record.u_age, sample.u_age);
  publish(messages_->on_sample, sample);

  residual_t& residual = messages_->residual;
  residual.utime = utime;
  residual.cycle = record.cycle;
  residual.residual = record.residual;
  residual.row_threshold = record.row_thresholds;
  residual.evaluation = record.evaluation;
  residual.threshold = record.thresholds;
  residual.fired = record.fired;
  publish(messages_->on_residual, residual);
}

const FaultEstimate* RunPublisher::publish_record(const DiagnosisRecord& record,
                                                  std::int64_t utime) {
  if (has_sinks()) publish_sample(record, utime);
  const bool is_isolated = record.decision.verdict == Verdict::kIsolated;
  const std::span<const std::size_t> isolated =
      is_isolated ? std::span<const std::size_t>(fault_sets_[record.decision.sets[0]])
                  : std::span<const std::size_t>();
  if (estimator_) estimator_->push(record, isolated);
  follow_inhibition(record, utime);
  const bool is_diagnosis_due = is_first_record_ || record.decision != last_decision_ ||
                                is_blame_new_ || record.cycle % cycles_per_second_ == 0;
  is_first_record_ = false;
  last_decision_ = record.decision;
  if (is_diagnosis_due && has_sinks()) publish_diagnosis(record, utime);
  if (!is_isolated || !estimator_) return nullptr;
  if (!is_diagnosis_due && !estimator_->is_first_due()) return nullptr;
  const FaultEstimate& estimate = estimator_->estimate(record, isolated);
  publish_estimate(estimate, record.cycle, utime);
  return &estimate;
}

/// EVENTs when a message inhibits the diagnosis and when that is over; one for each time.
void RunPublisher::follow_inhibition(const DiagnosisRecord& record, std::int64_t utime) {
  const bool is_inhibited = record.decision.verdict == Verdict::kInhibited;
  is_blame_new_ = is_inhibited && blame_.empty() && record.fault != MessageFault::kNone;
  if (is_blame_new_) {
    blame_ = blame_text(record);
    inhibited_at_ = record.cycle;
    bad_frames_then_ = last_bad_frames_;
    missing_then_ = last_missing_;
    publish_event(record.cycle, "warning", "diagnosis",
                  fmt::format("diagnosis inhibited: {}{}",
                              record.blamed_message.empty() ? "" : "message ", blame_),
                  utime);
  } else if (!is_inhibited && !blame_.empty()) {
    const double duration_s = (record.cycle - inhibited_at_) * inputs_->bank.sample_time_s;
    publish_event(record.cycle, "info", "diagnosis",
                  fmt::format("diagnosis recovered after {:.6g} s ({}): {} bad frames, {} messages "
                              "missing",
                              duration_s, blame_, last_bad_frames_ - bad_frames_then_,
                              last_missing_ - missing_then_),
                  utime);
    blame_.clear();
  }
  last_bad_frames_ = record.bad_frames;
  last_missing_ = record.missing_messages;
}

void RunPublisher::publish_diagnosis(const DiagnosisRecord& record, std::int64_t utime) {
  diagnosis_t& diagnosis = messages_->diagnosis;
  diagnosis.utime = utime;
  diagnosis.cycle = record.cycle;
  diagnosis.since_cycle = record.since_cycle;
  diagnosis.onset_cycle = record.onset.cycle;
  diagnosis.verdict = verdict_name(record.decision.verdict);
  diagnosis.cause = cause_name(record.decision.cause);
  diagnosis.blame = blame_text(record);
  diagnosis.set_total = static_cast<std::int32_t>(record.decision.set_count);
  const std::size_t listed = std::min<std::size_t>(record.decision.set_count, Decision::kMaxListed);
  diagnosis.set_count = static_cast<std::int32_t>(listed);
  diagnosis.sets.resize(listed);
  for (std::size_t i = 0; i < listed; ++i) {
    fault_set_t& set = diagnosis.sets[i];
    set.faults.clear();
    for (const std::size_t fault : fault_sets_[record.decision.sets[i]]) {
      set.faults.push_back(inputs_->bank.fault_names[fault]);
    }
    set.fault_count = static_cast<std::int32_t>(set.faults.size());
  }
  publish(messages_->on_diagnosis, diagnosis);
}

void RunPublisher::publish_estimate(const FaultEstimate& estimate, std::uint32_t cycle,
                                    std::int64_t utime) {
  const MagnitudeEstimate& magnitudes = estimate.magnitudes;
  estimate_t& message = messages_->estimate;
  message.utime = utime;
  message.cycle = cycle;
  message.onset_cycle = estimate.onset_cycle;
  message.reason = estimate_status_text(magnitudes.status);
  message.fault_count = static_cast<std::int32_t>(magnitudes.value.size());
  message.fault.clear();
  for (std::size_t i = 0; i < magnitudes.value.size(); ++i) {
    message.fault.push_back(inputs_->bank.fault_names[magnitudes.faults[i]]);
  }
  message.estimate = magnitudes.value;
  message.deviation = magnitudes.deviation;
  message.bound = magnitudes.bound;
  publish(messages_->on_estimate, message);
}

void RunPublisher::publish_truth(const PlantTruth& truth, const FaultSchedule& schedule,
                                 const Eigen::VectorXd& x, std::int64_t utime) {
  if (!has_sinks()) return;
  const double t_s = truth.cycle * inputs_->bank.sample_time_s;
  bool is_due = is_first_truth_ || truth.cycle % cycles_per_second_ == 0;
  last_activity_.resize(schedule.size(), 0.0);
  for (std::size_t i = 0; i < last_activity_.size(); ++i) {
    const double a = schedule.activity(i, t_s);
    const bool is_moving = a > 0.0 && is_moving_kind(schedule.injection(i).kind);
    is_due = is_due || is_moving || a != last_activity_[i];
    last_activity_[i] = a;
  }
  if (!is_due) return;
  is_first_truth_ = false;
  truth_t& message = messages_->truth;
  message.utime = utime;
  message.cycle = truth.cycle;
  message.faults.clear();
  for (std::size_t i = 0; i < last_activity_.size(); ++i) {
    const Injection& injection = schedule.injection(i);
    if (last_activity_[i] == 0.0) continue;
    injected_fault_t& fault = message.faults.emplace_back();
    fault.target = injection.target;
    fault.kind = injection_kind_name(injection.kind);
    fault.value = schedule.value(i, t_s);
  }
  message.fault_count = static_cast<std::int32_t>(message.faults.size());
  message.x.assign(x.data(), x.data() + x.size());
  message.state_count = static_cast<std::int32_t>(x.size());
  publish(messages_->on_truth, message);
}

void RunPublisher::publish_event(std::int64_t cycle, const std::string& severity,
                                 const std::string& source, const std::string& text,
                                 std::int64_t utime) {
  event_t& event = messages_->event;
  event.utime = utime;
  event.cycle = cycle;
  event.severity = severity;
  event.source = source;
  event.text = text;
  publish(messages_->on_event, event);
}

void RunPublisher::publish_stats(const RunCounters& counters,
                                 const std::vector<StageLatency>& latencies, std::int64_t cycle,
                                 std::int64_t utime, bool is_final) {
  stats_t& stats = messages_->stats;
  stats.utime = utime;
  stats.cycle = cycle;
  stats.is_final = is_final ? 1 : 0;
  stats.frames_sent = as_signed(counters.frames_sent);
  stats.send_errors = as_signed(counters.send_errors);
  stats.frames_received = as_signed(counters.frames_received);
  stats.frames_dropped = as_signed(counters.frames_dropped);
  stats.frames_unlogged = as_signed(counters.frames_unlogged);
  stats.samples = as_signed(counters.samples);
  stats.bad_samples = as_signed(counters.bad_samples);
  stats.late_cycles = as_signed(counters.late_cycles);
  stats.overruns = as_signed(counters.overruns);
  stats.skipped_cycles = as_signed(counters.skipped_cycles);
  stats.records_dropped = as_signed(counters.records_dropped);
  stats.resets = as_signed(counters.resets);
  stats.allocations = counters.allocations ? as_signed(*counters.allocations) : -1;
  stats.latency.clear();
  for (const StageLatency& stage : latencies) stats.latency.push_back(to_message(stage));
  stats.stage_count = static_cast<std::int32_t>(stats.latency.size());
  stats.channel.clear();
  stats.published.clear();
  for (const Channel* channel : messages_->channels()) {
    if (channel->next_sequence == 0 && channel != &messages_->on_stats) continue;
    stats.channel.emplace_back(channel->name);
    stats.published.push_back(channel->next_sequence + (channel == &messages_->on_stats ? 1 : 0));
  }
  stats.channel_count = static_cast<std::int32_t>(stats.channel.size());
  publish(messages_->on_stats, stats);
}

void RunPublisher::flush() {
  if (log_) log_->flush();
  if (live_) live_->flush();
}

void RunPublisher::close() {
  if (log_) log_->close();
  if (live_) live_->close();
}

}  // namespace faultline

#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/runtime/decision.h"
#include "drivers/can/can_bus.h"
#include "drivers/can/can_frame.h"
#include "drivers/signal/sampler.h"
#include "sim/fault_schedule.h"
#include "sim/frame_faults.h"
#include "sim/plant_node.h"
#include "tools/bench/diagnosis_inputs.h"
#include "tools/bench/diagnosis_record.h"
#include "tools/bench/fault_estimate.h"
#include "tools/bench/latency_histogram.h"
#include "tools/lcm/message_sink.h"

namespace faultline {

/// Counters of a run, for STATS and the summary. Only grow.
struct RunCounters {
  std::uint64_t cycles = 0;
  std::uint64_t frames_sent = 0;  ///< by plant and controller
  std::uint64_t send_errors = 0;
  std::uint64_t frames_received = 0;  ///< by the diagnosis node
  std::uint64_t frames_dropped = 0;
  std::uint64_t backlog_drops =
      0;  ///< packets lost before any socket of this machine; not in STATS
  std::uint64_t frames_unlogged = 0;  ///< received, but missing in the log: its queue was full
  std::uint64_t samples = 0;
  std::uint64_t bad_samples = 0;
  std::uint64_t resets = 0;
  std::uint64_t late_cycles = 0;
  std::uint64_t overruns = 0;
  std::uint64_t skipped_cycles = 0;
  std::uint64_t records_dropped = 0;
  std::uint64_t clamped_values = 0;
  FrameFaultCounters frame_faults;  ///< of plant and controller; not in STATS
  // Of the diagnosis thread after warm-up; nothing where it is not counted.
  std::optional<std::uint64_t> allocations;
  std::optional<std::uint64_t> page_faults;
};

/// Encodes everything a run has to say as LCM messages and hands them to its sinks. Each channel
/// counts its messages. Times are given by the caller: µs since 1970. Not for the diagnosis thread.
class RunPublisher {
 public:
  /// @param live gets RUN repeated by `repeat_parts`; `log` gets it once. Either may be null;
  /// where both are, nothing is encoded.
  RunPublisher(const DiagnosisInputs& inputs, std::vector<std::vector<std::size_t>> fault_sets,
               std::unique_ptr<MessageSink> log, std::unique_ptr<MessageSink> live,
               bool has_estimates = true);
  ~RunPublisher();

  /// RUN: all parts, in chunks, to all sinks.
  void publish_parts(std::int64_t utime);
  /// RUN again, to live LCM only, for those who joined late: the same messages, sequence numbers
  /// included.
  void repeat_parts();

  /// CAN: collects frames; sends a batch when it is full, before a frame of another bus, and before
  /// a gap. @param number running number of the frame among those the diagnosis node received
  void add_frame(const CanFrame& frame, std::uint64_t number, std::int64_t utime);
  /// CAN: sends what is collected.
  void flush_frames();

  /// SAMPLE, RESIDUAL, and DIAGNOSIS, ESTIMATE and EVENT (a message inhibits the diagnosis; it has
  /// recovered) when due.
  /// @return the ESTIMATE if one was sent, valid until the next call; else null.
  const FaultEstimate* publish_record(const DiagnosisRecord& record, std::int64_t utime);
  /// TRUTH, when due. `x` is the absolute state.
  void publish_truth(const PlantTruth& truth, const FaultSchedule& schedule,
                     const Eigen::VectorXd& x, std::int64_t utime);
  void publish_event(std::int64_t cycle, const std::string& severity, const std::string& source,
                     const std::string& text, std::int64_t utime);
  /// @param is_final the run is over: nothing is published after it.
  void publish_stats(const RunCounters& counters, const std::vector<StageLatency>& latencies,
                     std::int64_t cycle, std::int64_t utime, bool is_final);

  /// Hands what was written to the kernel.
  void flush();
  /// Flushes and closes all sinks. @throws MessageSinkError.
  void close();

  [[nodiscard]] bool has_log() const noexcept { return log_ != nullptr; }
  /// Messages published so far, all channels.
  [[nodiscard]] std::uint64_t message_count() const noexcept { return message_count_; }

 private:
  struct Messages;
  struct Channel;
  template <class Message>
  void publish(Channel& channel, Message& message);
  [[nodiscard]] bool has_sinks() const noexcept { return log_ || live_; }
  void send_parts();
  void publish_sample(const DiagnosisRecord& record, std::int64_t utime);
  void publish_diagnosis(const DiagnosisRecord& record, std::int64_t utime);
  void follow_inhibition(const DiagnosisRecord& record, std::int64_t utime);
  void publish_estimate(const FaultEstimate& estimate, std::uint32_t cycle, std::int64_t utime);

  const DiagnosisInputs* inputs_;
  std::vector<std::vector<std::size_t>> fault_sets_;
  std::unique_ptr<MessageSink> log_, live_;
  std::unique_ptr<Messages> messages_;
  std::vector<std::uint8_t> buffer_;
  std::string run_id_;
  std::uint32_t cycles_per_second_;
  std::int64_t parts_utime_ = 0;
  std::uint64_t next_frame_ = 0;  ///< number of the frame that would continue the batch
  bool is_first_record_ = true;
  Decision last_decision_;
  std::string blame_;  // of the inhibition announced by an EVENT; empty: none is
  bool is_blame_new_ = false;
  std::uint32_t inhibited_at_ = 0;
  // Totals when it began, and of the last record.
  std::uint64_t bad_frames_then_ = 0, missing_then_ = 0, last_bad_frames_ = 0, last_missing_ = 0;
  std::optional<FaultEstimator> estimator_;
  bool is_first_truth_ = true;
  std::vector<double> last_activity_;
  std::uint64_t message_count_ = 0;
};

}  // namespace faultline

#pragma once

#include <chrono>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "sim/fault_schedule.h"
#include "tools/bench/diagnosis_inputs.h"
#include "tools/bench/diagnosis_node.h"
#include "tools/bench/run_history.h"
#include "tools/bench/run_publisher.h"
#include "tools/bench/scenario.h"

namespace faultline {

/// Where the results of a live diagnosis go. Either sink may be null.
struct LiveDiagnosisOutput {
  std::unique_ptr<MessageSink> log, live;
  /// A verdict as it begins, and again when there is a first estimate for it.
  std::function<void(const VerdictEntry&)> on_verdict = [](const VerdictEntry&) {};
};

/// The diagnosis of one run that it only listens to: frames in, all channels of a run out (but
/// TRUTH, which only a simulator knows). Times are the frames' own stamps, so that a recorded run
/// gives the same messages whenever it is played. One thread; it is not the real-time path.
class LiveDiagnosis final : private DiagnosisSink {
 public:
  /// @param first_frame number of the first frame that will come. If it is not 0, the run began
  ///   before: what is known of its initial state says nothing any more.
  LiveDiagnosis(DiagnosisInputs inputs, LiveDiagnosisOutput output, std::uint64_t first_frame);
  LiveDiagnosis(const LiveDiagnosis&) = delete;
  LiveDiagnosis& operator=(const LiveDiagnosis&) = delete;

  /// A frame and its running number: a number that was jumped over is a frame that is missing,
  /// counted and told by an EVENT. @throws MessageSinkError.
  void on_frame(const CanFrame& frame, std::uint64_t number);
  /// EVENT, at the time of the last frame. @pre a frame has come
  void tell(const char* severity, const char* source, const std::string& text);
  /// The same at the time that the wall clock shows: of what no frame tells. Nothing is published
  /// before the first frame.
  void tell_now(const char* severity, const char* source, const std::string& text);
  /// Call when there is no frame for the moment: sends the frames collected, flushes, repeats RUN.
  void attend();
  /// The run is over: reports what is still open, and closes log and LCM.
  void finish();

  [[nodiscard]] const DiagnosisInputs& inputs() const noexcept { return inputs_; }
  [[nodiscard]] const RunHistory& history() const noexcept { return history_; }
  [[nodiscard]] const RunCounters& counters() const noexcept { return counters_; }
  [[nodiscard]] std::vector<MessageCounters> messages() const { return node_.message_counters(); }

 private:
  void on_received(const CanFrame& frame) noexcept override;
  void on_record(const DiagnosisRecord& record) noexcept override;
  void follow(const DiagnosisRecord& record);
  /// The node between is noexcept: what publishing throws waits here.
  template <class Action>
  void guard(const Action& action) noexcept;
  void rethrow();
  void begin(const CanFrame& frame, std::uint64_t number);

  DiagnosisInputs inputs_;
  LiveDiagnosisOutput output_;
  DiagnosisNode node_;
  Scenario no_scenario_;
  FaultSchedule no_faults_;
  RunPublisher publisher_;
  RunHistory history_;
  RunCounters counters_;
  std::exception_ptr error_;
  std::uint64_t number_ = 0;  ///< of the last frame
  std::int64_t utime_ = 0;    ///< of the last frame
  std::int64_t next_stats_utime_ = 0;
  std::int64_t cycle_ = -1;  ///< of the last sample
  std::size_t verdicts_told_ = 0;
  bool is_estimate_told_ = false;
  bool is_begun_ = false;
  std::chrono::steady_clock::time_point next_repeat_;
};

}  // namespace faultline

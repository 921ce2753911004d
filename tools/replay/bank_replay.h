#pragma once

#include <cstdint>
#include <memory>

#include "drivers/can/can_frame.h"
#include "sim/fault_schedule.h"
#include "tools/bench/diagnosis_inputs.h"
#include "tools/bench/diagnosis_node.h"
#include "tools/bench/run_history.h"
#include "tools/bench/run_publisher.h"
#include "tools/bench/scenario.h"
#include "tools/lcm/message_sink.h"

namespace faultline {

/// What a replay makes a diagnosis from. Scenario and schedule are empty where they are not known:
/// then nothing is expected and nothing was injected.
struct ReplayInputs : DiagnosisInputs {
  Scenario scenario;
  FaultSchedule schedule;
};

/// One bank's diagnosis of recorded frames: the same node and the same publisher as in a run, so
/// the same results.
class BankReplay final : private DiagnosisSink {
 public:
  /// @param inputs must outlive it.
  /// @param log may be null: gets all that a run's log gets, RUN and CAN included.
  /// @param results may be null: gets the results alone.
  BankReplay(const ReplayInputs& inputs, std::unique_ptr<MessageSink> log,
             std::unique_ptr<MessageSink> results);

  /// @param number running number of the frame in the record
  /// @throws MessageSinkError a log cannot be written.
  void on_frame(const CanFrame& frame, std::uint64_t number);
  /// No frame comes any more. @param is_complete the run ended here: what is open closes.
  void finish(bool is_complete);

  [[nodiscard]] const RunHistory& history() const noexcept { return history_; }
  [[nodiscard]] const RunCounters& counters() const noexcept { return counters_; }

 private:
  void on_received(const CanFrame& frame) noexcept override;
  void on_record(const DiagnosisRecord& record) noexcept override;
  void rethrow() const;

  DiagnosisNode node_;
  RunPublisher publisher_;
  RunHistory history_;
  RunCounters counters_;
  bool has_log_;
  bool is_begun_ = false;
  std::int64_t utime_ = 0;
  std::uint32_t cycle_ = 0;
  std::exception_ptr error_;  ///< what publishing threw: the node between is noexcept
};

}  // namespace faultline

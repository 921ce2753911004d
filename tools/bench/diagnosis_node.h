#pragma once

#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/evaluator.h"
#include "diagnosis/runtime/onset.h"
#include "diagnosis/runtime/residual_bank.h"
#include "drivers/can/can_frame.h"
#include "drivers/signal/sampler.h"
#include "drivers/signal/signal_map.h"
#include "tools/bench/diagnosis_record.h"

namespace faultline {

/// The diagnosis as a state machine on a bus: frames in, one DiagnosisRecord per sample out.
///
///   frame → Sampler → ResidualBank → Evaluator → DecisionTable → Settling → OnsetTracker → record
///
/// While a bad sample inhibits, the record names the message to blame: the first since the verdict
/// became inhibited.
///
/// It only listens. What it finds is a function of the frames it is given, in their order, and of
/// nothing else. Real-time: after construction it does not allocate, throw, lock or read a clock.
class DiagnosisNode {
 public:
  /// @param is_initial_state_known the plant starts at the operating point: nothing to forget
  /// first.
  DiagnosisNode(const SignalMap& map, const Bank& bank, bool is_initial_state_known);

  void on_frame(const CanFrame& frame, DiagnosisSink& sink) noexcept;
  /// The run is over: reports what is still open.
  void finish(DiagnosisSink& sink) noexcept;

  [[nodiscard]] const SamplerCounters& sampler_counters() const noexcept {
    return sampler_.counters();
  }
  /// Per mapped message, by its index in the SignalMap. Not for the diagnosis thread.
  [[nodiscard]] std::vector<MessageCounters> message_counters() const;
  [[nodiscard]] const DecisionTable& decision_table() const noexcept { return table_; }

 private:
  void take_samples(DiagnosisSink& sink) noexcept;
  void on_sample(const Sample& sample, DiagnosisSink& sink) noexcept;
  void mark_contamination(const Sample& sample) noexcept;
  void find_blame(const Sample& sample, const Decision& announced) noexcept;

  std::vector<std::string> message_names_;
  Sampler sampler_;
  ResidualBank bank_;
  Evaluator evaluator_;
  DecisionTable table_;
  Settling settling_;
  OnsetTracker onset_;
  Blame blame_;  // of the present inhibition
  DiagnosisRecord record_;
};

}  // namespace faultline

#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tools/report/run_record.h"

namespace faultline {

/// A stretch of a run in which the same faults acted.
struct TruthStretch {
  CycleRange cycles;
  /// Sorted. Faults of frames are none of the plant, and not among them: a bank that calls them a
  /// plant fault is wrong.
  std::vector<std::string> faults;
};

/// What the diagnosis made of one stretch with faults.
struct FaultOutcome {
  TruthStretch truth;
  /// From its beginning to the first alarm in it that is another verdict than the one before it.
  std::optional<std::int64_t> detection_delay;  ///< cycles
  /// From its beginning to the first verdict in it, announced after that, that is isolated with
  /// exactly these faults.
  std::optional<std::int64_t> isolation_delay;  ///< cycles
  bool is_detected = false;                     ///< in some cycle of it there is an alarm
};

/// How well verdicts agree with what was injected; counted in cycles k that have both a verdict
/// v(k) and a truth F(k), the set of acting faults. An alarm is a verdict of isolated, ambiguous or
/// unexplained.
///
///   TDR = #{F ≠ ∅, alarm} / #{F ≠ ∅}                   true detection rate
///   MDR = 1 - TDR                                       missed-detection rate
///   FAR = #{F = ∅, alarm} / #{F = ∅, not inhibited}     false-alarm rate
///   FIA = Σ_{F ≠ ∅, alarm} s(k) / #{F ≠ ∅, alarm}       fault isolation accuracy
///
/// s = 1 where isolated with exactly F, 1/n where F is one of n ambiguous sets, else 0. Inhibited
/// cycles of a fault count as not detected. Alarms that outlast their fault are alarms without a
/// fault; how many cycles those are stands beside FAR. A rate whose denominator is zero is absent.
/// Names: the diagnostic competitions of the DX workshop; those score a run likewise, but take the
/// probability that a method gives to the true fault where this takes s.
struct DiagnosisMetrics {
  std::int64_t faulty_cycles = 0, detected_cycles = 0;
  std::int64_t faultless_cycles = 0, false_alarm_cycles = 0;
  /// Of the false alarms' cycles, those of alarms that began while a fault acted and outlast it.
  std::int64_t clearing_cycles = 0;
  std::uint64_t false_alarms = 0;  ///< alarms that began while no fault acted
  double isolation_score = 0.0;    ///< Σ s(k)
  std::int64_t inhibited_cycles = 0;
  std::vector<FaultOutcome> outcomes;
  std::uint64_t missed_faults = 0;  ///< stretches with faults and no alarm
  /// Cycles by truth ("none", "u2, u3") and verdict ("healthy", "isolated u2, u3", "ambiguous" ..).
  std::map<std::string, std::map<std::string, std::int64_t>> confusion;

  [[nodiscard]] std::optional<double> true_detection_rate() const noexcept;
  [[nodiscard]] std::optional<double> missed_detection_rate() const noexcept;
  [[nodiscard]] std::optional<double> false_alarm_rate() const noexcept;
  [[nodiscard]] std::optional<double> fault_isolation_accuracy() const noexcept;
};

/// The stretches into which `faults` divide `cycles`, those without a fault included.
[[nodiscard]] std::vector<TruthStretch> truth_stretches(const std::vector<RecordedFault>& faults,
                                                        CycleRange cycles);

/// @pre both in order, each without overlap
[[nodiscard]] DiagnosisMetrics diagnosis_metrics(const std::vector<TruthStretch>& truth,
                                                 const std::vector<VerdictStretch>& verdicts);

/// "isolated u2, u3", "ambiguous u1 | u2", "unexplained", "healthy", "inhibited".
[[nodiscard]] std::string verdict_words(const VerdictStretch& stretch);

}  // namespace faultline

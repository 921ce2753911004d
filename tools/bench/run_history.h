#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "sim/fault_schedule.h"
#include "tools/bench/diagnosis_record.h"
#include "tools/bench/fault_estimate.h"
#include "tools/bench/scenario.h"

namespace faultline {

/// The estimated magnitude of one fault, in its unit.
struct EstimateEntry {
  std::string fault;
  double value = 0.0;
  double deviation = 0.0;                      ///< one standard deviation; negative: not known
  double bound = MagnitudeEstimate::kUnknown;  ///< proved of |value - truth|; negative: nothing was
};

/// A verdict in words: the announced decision from `t_s` on.
struct VerdictEntry {
  double t_s = 0.0;
  Verdict verdict = Verdict::kInhibited;
  /// isolated: the fault set, sorted; ambiguous, unexplained by a partial signature: the
  /// candidates.
  std::vector<std::vector<std::string>> sets{};
  Cause cause = Cause::kNone;
  /// The cause, where it is worth a remark: "they cancel in r14", "more than 2 faults".
  std::string note{};
  /// Estimated time from which the faults act; else the first crossing that led to the verdict.
  std::optional<double> onset_s{};
  std::vector<EstimateEntry> estimates{};  ///< isolated: the last ones, in the order of the set
  std::string no_estimate{};               ///< isolated: why there are none
  std::string blame{};                     ///< inhibited: "Sensors1: wrong CRC"; may be empty
};

/// An injected bias that is smaller than what the bank is sure to isolate.
struct SmallFault {
  std::string fault;
  double value = 0.0;     ///< injected, in the fault's unit
  double smallest = 0.0;  ///< size from which every residual that sees it at DC fires on it
};

/// A stretch of time in which the same faults were injected, and what the diagnosis made of it.
struct InjectionOutcome {
  double from_s = 0.0;
  double until_s = 0.0;
  std::vector<std::string> faults{};  ///< sorted; empty: none
  std::optional<double>
      detection_delay_s{};  ///< first announced verdict after from_s that is neither
                            ///< healthy nor inhibited, and not the one before
  std::optional<double> isolation_delay_s{};  ///< first "isolated" with exactly these faults
  std::size_t last_verdict = 0;               ///< verdict at its end: index in verdicts()
  std::vector<SmallFault> small_faults{};     ///< of those injected, at its end
};

/// Whether one [[expect]] was met.
struct ExpectationOutcome {
  Expectation expectation;
  bool is_met = false;
  std::uint64_t samples = 0;                  ///< samples compared
  std::optional<VerdictEntry> first_unmet{};  ///< first sample that differed
};

/// Follows a run's records and keeps what the summary tells: changes of the verdict, first
/// crossings, expectations, delays.
class RunHistory {
 public:
  RunHistory(const Bank& bank, const std::vector<std::vector<std::size_t>>& fault_sets,
             const Scenario& scenario, const FaultSchedule& schedule);

  void on_record(const DiagnosisRecord& record);
  /// What was estimated after the last record.
  void on_estimate(const FaultEstimate& estimate);

  [[nodiscard]] const std::vector<VerdictEntry>& verdicts() const noexcept { return verdicts_; }
  /// Per filter: time at which it first fired.
  [[nodiscard]] const std::vector<std::optional<double>>& first_fired_s() const noexcept {
    return first_fired_s_;
  }
  [[nodiscard]] const std::vector<InjectionOutcome>& injections() const noexcept {
    return injections_;
  }
  /// What became of the expectations; those that no sample reached are not met.
  [[nodiscard]] std::vector<ExpectationOutcome> expectations() const;
  [[nodiscard]] bool are_expectations_met() const;
  [[nodiscard]] std::uint64_t samples() const noexcept { return samples_; }

 private:
  [[nodiscard]] VerdictEntry entry_of(const DiagnosisRecord& record, double t_s) const;
  [[nodiscard]] std::string note_of(const DiagnosisRecord& record) const;
  void follow_injections(bool is_change);
  void find_small_faults(InjectionOutcome& outcome) const;
  void check_expectations();

  const Bank* bank_;
  const std::vector<std::vector<std::size_t>>* fault_sets_;
  const FaultSchedule* schedule_;
  std::vector<VerdictEntry> verdicts_;
  std::vector<std::optional<double>> first_fired_s_;
  std::vector<double> smallest_isolated_;  ///< per fault; 0: not known
  std::vector<InjectionOutcome> injections_;
  std::vector<ExpectationOutcome> expectations_;
  std::optional<Decision> last_decision_;
  VerdictEntry now_;                  ///< the announced verdict at the current sample, no estimates
  std::vector<std::uint8_t> active_;  ///< per injection: acting at the current sample
  std::vector<std::uint8_t> active_before_;
  std::uint64_t samples_ = 0;
};

/// "isolated u2, u3", "ambiguous u1, u2 | u3, u4", "unexplained", "healthy", "inhibited (Sensors1:
/// wrong CRC)".
[[nodiscard]] std::string verdict_text(const VerdictEntry& entry);

/// What is known beyond verdict_text: "u2 = 2.00 +- 0.01, u3 = 2.00 +- 0.01; onset 3.99 s; they
/// cancel in r14", "y1 = 0.203, within 0.015" (a proved bound, not a deviation), "partial
/// signature, could be u1 | u4 below a threshold"; may be empty.
[[nodiscard]] std::string verdict_detail(const VerdictEntry& entry);

}  // namespace faultline

#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "sim/fault_schedule.h"
#include "tools/bench/diagnosis_record.h"
#include "tools/bench/expectation_watch.h"
#include "tools/bench/fault_estimate.h"
#include "tools/bench/scenario.h"
#include "tools/bench/verdict_entry.h"

namespace faultline {

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

/// Size from which every residual that sees `fault` at DC fires on it, in its unit; 0 if the bank
/// does not say.
[[nodiscard]] double smallest_isolated(const Bank& bank, std::size_t fault);

/// No other single fault is seen by the same residuals in the same way: only then can it be named.
[[nodiscard]] bool has_own_signature(const Bank& bank, std::size_t fault);

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

  const Bank* bank_;
  const std::vector<std::vector<std::size_t>>* fault_sets_;
  const FaultSchedule* schedule_;
  std::vector<VerdictEntry> verdicts_;
  std::vector<std::optional<double>> first_fired_s_;
  std::vector<double> smallest_isolated_;  ///< per fault; 0: not known
  std::vector<InjectionOutcome> injections_;
  std::vector<ExpectationWatch> expectations_;
  std::optional<Decision> last_decision_;
  VerdictEntry now_;                  ///< the announced verdict at the current sample, no estimates
  std::vector<std::uint8_t> active_;  ///< per injection: acting at the current sample
  std::vector<std::uint8_t> active_before_;
  std::uint64_t samples_ = 0;
};

}  // namespace faultline

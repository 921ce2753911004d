#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/bench/diagnosis_record.h"
#include "tools/bench/expectation.h"
#include "tools/bench/verdict_entry.h"

namespace faultline {

/// Whether one [[expect]] was met.
struct ExpectationOutcome {
  Expectation expectation;
  bool is_met = false;
  /// No later sample can change the answer: it is past its time, or what it forbids has happened.
  bool is_final = false;
  std::uint64_t samples = 0;                  ///< samples compared
  std::optional<VerdictEntry> first_unmet{};  ///< first sample whose verdict differed
  /// What was found instead, and when: "found healthy at 4.3 s"; empty if it is met.
  std::string found{};
  /// Time from from_s to the verdict that stood at the deadline; only with within_s.
  std::optional<double> delay_s{};
};

/// Compares one expectation with the samples of a run, as they come.
class ExpectationWatch {
 public:
  explicit ExpectationWatch(Expectation expectation);

  /// The next sample: its record and the same in words, at now.t_s.
  void on_sample(const DiagnosisRecord& record, const VerdictEntry& now);
  /// What was estimated after the last sample, or why nothing was.
  void on_estimates(double t_s, const std::vector<EstimateEntry>& estimates);
  void on_no_estimate(std::string_view reason);

  [[nodiscard]] ExpectationOutcome outcome() const;

 private:
  [[nodiscard]] bool agrees(const DiagnosisRecord& record, const VerdictEntry& now) const;
  void watch_verdict(const DiagnosisRecord& record, const VerdictEntry& now);
  void watch_blame(const DiagnosisRecord& record, const VerdictEntry& now);
  [[nodiscard]] std::string unmet_estimate() const;
  void refuse(const VerdictEntry& now, std::string found);

  Expectation expectation_;
  std::uint64_t samples_ = 0;
  bool is_over_ = false;                  ///< the last sample is the stretch's last, or later
  bool is_inside_ = false;                ///< the last sample lay in the stretch
  std::optional<VerdictEntry> waiting_;   ///< before the deadline: the verdict differs since
  std::optional<double> agrees_since_s_;  ///< before the deadline: the verdict agrees since
  std::optional<VerdictEntry> first_unmet_;
  std::string found_;
  bool was_blamed_ = false;               ///< as expected, at one sample at least
  std::vector<EstimateEntry> estimates_;  ///< the last ones of the stretch
  double estimated_at_s_ = 0.0;
  std::string no_estimate_;
};

}  // namespace faultline

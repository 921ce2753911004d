#pragma once

#include <optional>
#include <string>
#include <vector>

#include "diagnosis/runtime/decision.h"

namespace faultline {

/// What the estimate of one fault must be, in the fault's unit.
struct ExpectedEstimate {
  std::string fault;
  double value = 0.0;
  double tolerance = 0.0;  ///< |estimate - value| <= tolerance
};

/// What the diagnosis must answer from from_s to until_s, both included: [[expect]] of a scenario.
///
/// At every sample of the stretch, or of what is left of it `within_s` after its begin, the verdict
/// is one of `verdicts`; isolated means exactly `faults` (any if there are none), ambiguous means
/// `sets`.
struct Expectation {
  double from_s = 0.0;
  double until_s = 0.0;
  std::vector<Verdict> verdicts;               ///< those allowed; never empty
  std::vector<std::string> faults;             ///< of isolated; sorted; empty: any
  std::vector<std::vector<std::string>> sets;  ///< of ambiguous; each sorted, and their list
  bool may_have_more_sets = false;             ///< `sets` are among those found
  std::optional<double> within_s;              ///< the verdict must stand so long after from_s
  std::vector<ExpectedEstimate> estimates;     ///< the last ones made in the stretch
  bool has_no_false_alarm = false;             ///< at no sample isolated, ambiguous or unexplained
  std::vector<std::string> blamed;         ///< messages, one of which inhibits at least once, and
                                           ///< nothing else does
  std::vector<std::string> blamed_faults;  ///< likewise what the message did, "wrong CRC"

  [[nodiscard]] bool allows(Verdict verdict) const noexcept;
  /// The time from which the verdict must stand.
  [[nodiscard]] double deadline_s() const noexcept { return from_s + within_s.value_or(0.0); }
  /// Whether it says which message is to blame, or what for.
  [[nodiscard]] bool has_blame() const noexcept {
    return !blamed.empty() || !blamed_faults.empty();
  }
};

/// "4 .. 10 s  isolated u2, u3 within 0.3 s; u2 = 2 +- 0.1".
[[nodiscard]] std::string expectation_words(const Expectation& expectation);

}  // namespace faultline

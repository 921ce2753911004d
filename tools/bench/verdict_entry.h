#pragma once

#include <optional>
#include <string>
#include <vector>

#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/estimator.h"

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

/// "isolated u2, u3", "ambiguous u1, u2 | u3, u4", "unexplained", "healthy", "inhibited (Sensors1:
/// wrong CRC)".
[[nodiscard]] std::string verdict_text(const VerdictEntry& entry);

/// What is known beyond verdict_text: "u2 = 2.00 +- 0.01, u3 = 2.00 +- 0.01; onset 3.99 s; they
/// cancel in r14", "y1 = 0.203, within 0.015" (a proved bound, not a deviation), "partial
/// signature, could be u1 | u4 below a threshold"; may be empty.
[[nodiscard]] std::string verdict_detail(const VerdictEntry& entry);

}  // namespace faultline

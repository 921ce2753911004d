#pragma once

#include <array>
#include <string>
#include <vector>

#include "tools/report/chart_data.h"
#include "tools/report/diagnosis_metrics.h"
#include "tools/report/run_record.h"

namespace faultline {

/// A run with what is computed of it.
struct ReportedRun {
  std::string label;  ///< "", or "A", "B" of two
  RunRecord record;
  std::vector<TruthStretch> truth;  ///< empty without TRUTH
  DiagnosisMetrics metrics;         ///< of no cycle without TRUTH

  /// "", or " of run A".
  [[nodiscard]] std::string of_run() const { return label.empty() ? "" : " of run " + label; }
};

/// Stretches of a run in which faults acted, in seconds.
[[nodiscard]] std::vector<std::array<double, 2>> fault_stretches_s(const ReportedRun& run);
/// A run with all that is computed of it.
[[nodiscard]] ReportedRun evaluated(RunRecord record);

// Each makes one section of the page, as HTML. Charts go to `charts`.

/// What the page is about, in numbers; what is missing.
[[nodiscard]] std::string overview_section(const std::vector<ReportedRun>& runs);
/// Verdict against truth on a timeline, and both as a table.
[[nodiscard]] std::string timeline_section(const std::vector<ReportedRun>& runs);
/// The timeline of one run, without its tables.
[[nodiscard]] std::string run_timeline(const ReportedRun& run);
/// TDR, FAR, FIA, delays, confusion matrix.
[[nodiscard]] std::string metrics_section(const std::vector<ReportedRun>& runs);
/// A chart per residual, input, output and estimate; of two runs laid over each other.
[[nodiscard]] std::string residual_section(const std::vector<ReportedRun>& runs, ChartData& data);
/// The charts of some residuals of one run, in the order of `names`; none: of all.
[[nodiscard]] std::string residual_charts(const ReportedRun& run,
                                          const std::vector<std::string>& names, ChartData& data);
[[nodiscard]] std::string signal_section(const std::vector<ReportedRun>& runs, ChartData& data);
/// Structure matrix beside the observed signatures; certificates in words.
[[nodiscard]] std::string bank_section(const std::vector<ReportedRun>& runs);
/// Frames, messages, periods, latencies.
[[nodiscard]] std::string traffic_section(const std::vector<ReportedRun>& runs);
/// Events; scenario, files, digests, versions: what it takes to repeat the run.
[[nodiscard]] std::string source_section(const std::vector<ReportedRun>& runs,
                                         const std::string& version);

}  // namespace faultline

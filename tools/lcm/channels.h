#pragma once

namespace faultline {

// LCM channels (docs/design.md, "LCM channels").
inline constexpr char kRunChannel[] = "FAULTLINE_RUN";
inline constexpr char kCanChannel[] = "FAULTLINE_CAN";
inline constexpr char kSampleChannel[] = "FAULTLINE_SAMPLE";
inline constexpr char kResidualChannel[] = "FAULTLINE_RESIDUAL";
inline constexpr char kDiagnosisChannel[] = "FAULTLINE_DIAGNOSIS";
inline constexpr char kEstimateChannel[] = "FAULTLINE_ESTIMATE";
inline constexpr char kTruthChannel[] = "FAULTLINE_TRUTH";
inline constexpr char kInjectChannel[] = "FAULTLINE_INJECT";
inline constexpr char kEventChannel[] = "FAULTLINE_EVENT";
inline constexpr char kStatsChannel[] = "FAULTLINE_STATS";

}  // namespace faultline

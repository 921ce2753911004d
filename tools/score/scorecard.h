#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tools/campaign/campaign_database.h"
#include "tools/score/estimates.h"

namespace faultline {

/// A run as a score needs it; runs that failed are not among them.
struct ScoredRun {
  std::uint64_t run = 0;
  std::int64_t seed = 0;
  std::string point, truth, kind, verdict;  ///< truth "none": no fault acted
  std::optional<double> size;               ///< |.|
  std::optional<double> detection_delay_s, isolation_delay_s;
  bool is_detected = false;
  std::vector<std::optional<double>> peak_faultless, peak_faulty;  ///< per residual
  [[nodiscard]] bool has_fault() const noexcept { return truth != "none"; }
};

/// How one kind of fault on one set of targets was found.
struct FaultScore {
  std::string truth, kind;
  std::uint64_t runs = 0;
  Estimate detected, isolated;  ///< shares of the runs
  /// From the onset; runs in which it did not happen count as later than all others.
  std::optional<Estimate> detection_median_s, detection_p95_s, isolation_median_s, isolation_p95_s;
  DetectableSize detectable;        ///< detected in 95 % of the cases
  std::optional<double> predicted;  ///< size from which the design promises isolation
  std::vector<Trial> trials;        ///< with a size that is known
};

struct ResidualScore {
  std::string name;
  std::optional<Estimate> area_under_roc;
};

/// A point of a ROC curve: all thresholds of the bank times `scale`.
struct RocPoint {
  double scale = 0.0, false_alarms = 0.0, detections = 0.0;  ///< shares of runs
};

/// What a campaign says of a bank. Names are those of the DX competitions, as in `report`.
struct Scorecard {
  CampaignIdentity campaign;
  std::uint64_t runs = 0, failed = 0, faulty = 0;
  std::optional<Estimate> TDR, FAR, FIA, missed_detection_rate;  ///< over cycles, clustered by run
  std::uint64_t false_alarms = 0;
  double faultless_h = 0.0;
  std::optional<Estimate> false_alarms_per_h;
  std::vector<FaultScore> faults;
  /// Runs by truth and final verdict.
  std::map<std::string, std::map<std::string, std::uint64_t>> confusion;
  std::vector<ResidualScore> residuals;
  std::vector<RocPoint> roc;  ///< of the bank: any residual above its threshold
  std::vector<ScoredRun> all;
};

/// @throws InputError rows that are none; DatabaseError.
[[nodiscard]] Scorecard scorecard_of(const CampaignDatabase& database);

/// Two banks on the same runs: those with the same number, seed and point in both.
struct Comparison {
  std::uint64_t pairs = 0;
  std::uint64_t faulty = 0;  ///< of them
  std::uint64_t only_a_detects = 0, only_b_detects = 0;
  std::uint64_t only_a_isolates = 0, only_b_isolates = 0;
  /// Share detected (isolated) by B less that by A; interval from the discordant pairs.
  std::optional<Estimate> detected_difference, isolated_difference;
  /// Of runs that both detect: delay of B less that of A.
  std::optional<Estimate> delay_difference_s;  ///< median
};
[[nodiscard]] Comparison compare(const Scorecard& a, const Scorecard& b);

}  // namespace faultline

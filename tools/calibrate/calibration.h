#pragma once

#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/recorded_unknown_inputs.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

struct CalibrationOptions {
  double false_alarms_per_h = 0.0;  ///< of the whole bank
  double held_out = 0.3;            ///< part of the record, its end, that is not fitted
};

/// Gives every residual the threshold at which the fault-free record lets it fire its share of the
/// false alarms (one in the number of residuals): what fires is an evaluation signal that stays
/// above for `dwell` samples, so the series is the smallest of `dwell` evaluations in a row. Its
/// peaks, clusters as far apart as its own correlation reaches, get a generalised Pareto tail
/// (tail_fit.h); alarms that follow each other closer than that count as one.
///
/// Then the certificates anew: what depends on thresholds (smallest faults, delays, forgetting).
///
/// Refuses (std::invalid_argument, with what was found):
/// - thresholds that are proved (certified, method "uio"): they need no record;
/// - a residual that does not move: no noise, no tail;
/// - a record in which a residual stands elsewhere for a while: a fault that was given as none;
/// - too few independent peaks; or a rate so small that the record would be extrapolated more than
/// a
///   hundredfold: with the hours that it takes, and the rate that these hours carry;
/// - a held-out part that peaks more or less often than the fitted one (probability below 0.1 %,
///   all residuals together).
/// `stretches` in deviations from the operating point, as read_recorded_samples() gives them.
void calibrate(const PlantModel& plant, const std::vector<RecordedStretch>& stretches,
               const CalibrationOptions& options, Bank& bank);

/// How far beyond the record a rate may lie: expected alarms in it, at least 1/kFurthest.
inline constexpr double kFurthest = 100.0;

}  // namespace faultline

#pragma once

#include <optional>
#include <string>
#include <vector>

#include "diagnosis/design/recorded_unknown_inputs.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// The good samples of logs.
struct RecordedSamples {
  /// Consecutive ones, in deviations from the plant's operating point; a bad sample, a gap or the
  /// end of a log ends one.
  std::vector<RecordedStretch> stretches;
  std::optional<double> sample_time_s;  ///< of the recorded bank
  std::vector<std::string> remarks;     ///< what was passed over
};

/// Reads the SAMPLE messages of LCM logs, each log by itself.
/// @throws std::invalid_argument no LCM log; a fault acted (TRUTH); a sample of another number of
///   channels than the plant's; logs of different sample times; no sample at all
/// @throws std::system_error a log cannot be read
[[nodiscard]] RecordedSamples read_recorded_samples(const std::vector<std::string>& logs,
                                                    const PlantModel& plant);

}  // namespace faultline

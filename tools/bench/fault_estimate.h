#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/estimating_filters.h"
#include "diagnosis/runtime/estimator.h"
#include "diagnosis/runtime/onset.h"
#include "tools/bench/diagnosis_inputs.h"
#include "tools/bench/diagnosis_record.h"

namespace faultline {

/// What an ESTIMATE says of an isolated set.
struct FaultEstimate {
  MagnitudeEstimate magnitudes;
  /// Estimated cycle from which the faults act: Onset::cycle less the response delay of its
  /// residual to the magnitudes; Onset::cycle where that is not known.
  std::int64_t onset_cycle = Onset::kNone;
};

/// Estimates the sizes of the isolated faults of a run, sample by sample: a single fault by the
/// filter that estimates it, if the bank has one, all other sets from the window of residuals. Not
/// for the diagnosis thread.
class FaultEstimator {
 public:
  explicit FaultEstimator(const DiagnosisInputs& inputs);

  /// Takes the record of the next sample. @param isolated the faults of an isolated set, else empty
  void push(const DiagnosisRecord& record, std::span<const std::size_t> isolated);
  /// True if the set of the last sample has not been estimated yet, and now can be.
  [[nodiscard]] bool is_first_due() const noexcept { return is_pending_ && is_ready_; }
  /// Estimates the isolated set of the last sample, or says why not. @pre it was not empty
  /// @return valid until the next call.
  const FaultEstimate& estimate(const DiagnosisRecord& record,
                                std::span<const std::size_t> isolated);

 private:
  [[nodiscard]] bool is_ready(const DiagnosisRecord& record,
                              std::span<const std::size_t> isolated) const;
  void refine_onset(const DiagnosisRecord& record);

  MagnitudeEstimator window_;
  EstimatingFilters filters_;
  FaultEstimate estimate_;
  Decision last_decision_;
  bool is_first_record_ = true;
  bool is_pending_ = false;  // a set is isolated, and not estimated yet
  bool is_ready_ = false;    // it could be estimated after the last sample
};

}  // namespace faultline

#pragma once

#include <cstdint>

#include "diagnosis/runtime/estimator.h"
#include "diagnosis/runtime/onset.h"

namespace faultline {

/// What an ESTIMATE says of an isolated set.
struct FaultEstimate {
  MagnitudeEstimate magnitudes;
  /// Estimated cycle from which the faults act: Onset::cycle less the response delay of its
  /// residual to the magnitudes; Onset::cycle where that is not known.
  std::int64_t onset_cycle = Onset::kNone;
};

}  // namespace faultline

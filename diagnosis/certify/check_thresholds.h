#pragma once

#include "diagnosis/bank/bank.h"
#include "diagnosis/certify/check.h"
#include "diagnosis/certify/linear_thresholds.h"

namespace faultline {

/// Holds the certified thresholds of a linear filter against what was recomputed.
void check_thresholds(const LinearThresholdProof& proof, const ResidualFilter& filter,
                      CheckResult& result);

}  // namespace faultline

#pragma once

#include "diagnosis/bank/bank.h"
#include "diagnosis/certify/check.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Holds what a filter claims as an observer against what plant and observer say; what differs goes
/// into `result`. A filter that is none must not claim anything of the kind. The lists of the bank
/// must fit the plant's.
void check_observer(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter,
                    CheckResult& result);

}  // namespace faultline

#pragma once

#include "diagnosis/bank/bank.h"
#include "diagnosis/certify/check.h"
#include "diagnosis/certify/filter_proof.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Holds the claims that any filter makes against what was recomputed; what differs goes into
/// `result`. The lists of the bank must fit the plant's.
void check_filter(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter,
                  const FilterProof& proof, CheckResult& result);

}  // namespace faultline

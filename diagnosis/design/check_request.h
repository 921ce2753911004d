#pragma once

#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Refuses what cannot be asked of this plant, with its place in the request where that is known.
/// @throws InputError poles outside the stable region or unpaired, another sample time or domain
///   than a discrete plant has, as many concurrent faults as there are, no state, output or fault,
///   numbers that are not finite, a threshold that is not positive.
void check_request(const PlantModel& plant, const BankRequest& request);

}  // namespace faultline

#pragma once

#include <string>
#include <vector>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// design_bank(), and the certificates of the bank it found: what may be written or run.
/// @throws InputError as design_bank, and where certify refuses: at `plant` of the request.
[[nodiscard]] DesignResult designed_and_certified(const PlantModel& plant,
                                                  const BankRequest& request,
                                                  const DesignProgress& progress = {});

/// What fails, one sentence per set of ignored faults and reason:
/// "ignoring {u1, u2} hides u3, u4: ..."; empty if nothing does.
[[nodiscard]] std::vector<std::string> failure_sentences(const DesignResult& result);

}  // namespace faultline

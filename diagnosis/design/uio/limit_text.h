#pragma once

#include <string>

#include "diagnosis/design/uio/observer_plant.h"
#include "diagnosis/design/uio/structural_limits.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// "the pair (S A, C) has an undetectable mode at 1.71 (..)": what it means, and what to change.
[[nodiscard]] std::string fixed_mode_text(const FixedMode& mode, bool is_decoupling);

/// "a constant u1 of 1 looks exactly like y1 of -0.478": what it means, and what to change.
[[nodiscard]] std::string hidden_fault_text(const PlantModel& plant, const ObserverTask& task,
                                            const HiddenFault& hidden, bool is_decoupling);

}  // namespace faultline

#pragma once

#include "diagnosis/design/design_bank.h"

namespace faultline {

/// Designs the observers that a request of method "uio" asks for: one that detects, residual y - ŷ,
/// and, if asked for, one that estimates the sizes of faults, one residual for each. Ways of
/// decoupling and decay rates are all tried and the best is taken: for detection the one with the
/// smallest fault that is detected for sure, for estimation the one with the smallest J_th.
///
/// Source: Ma, Gao, Guo, Control Theory & Applications 41(2), 2024, 240-248, corrected
/// (docs/decisions/0017-corrected-observer-theory.md).
/// @throws InputError what is asked cannot be asked of this plant.
[[nodiscard]] DesignResult design_uio_bank(const PlantModel& plant, const BankRequest& request,
                                           const DesignProgress& progress);

}  // namespace faultline

#pragma once

#include <cstdint>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// How long a bad sample contaminates a residual: the first j >= 1 from which
///
///   ‖M F^(i-1)‖_F ρ < 0.01 τ   for all i > j
///
/// (the bad sample itself counts as one), ρ the largest error of the filter's state that a bad
/// sample or an unknown start leaves: the largest range of a channel, or ‖|E| ȳ + |G| ū‖₂ of the
/// ranges ȳ, ū. At most 1,000,000. docs/decisions/0003-forgetting.md.
///
/// `filter` stable; `threshold_factor` multiplies τ.
[[nodiscard]] std::uint32_t samples_to_forget(const PlantModel& plant, const ResidualFilter& filter,
                                              double threshold_factor = 1.0);

}  // namespace faultline

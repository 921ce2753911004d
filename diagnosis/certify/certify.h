#pragma once

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Fills the certificates of `bank`: of each filter, and `isolability`. From plant and bank alone:
/// this folder shares no code with diagnosis/design.
///
/// Of an observer it needs the matrices of the filter, `sees`, the evaluation, Ω (none: I), the
/// fault that is estimated, and T, Γ, the carried faults, α, P, μ, β with its faults and band. It
/// fills the rest: course, threshold, estimation, forget_samples, transient_samples, corners and
/// faults of the observer's certificate. The certificate that all filters have is of its nominal
/// loop, the slopes in their middle; smallest faults and delays count by its own evaluation.
///
/// A certificate holds finite numbers only. Where the plant has a mode on the unit circle that a
/// filter does not cancel (an undamped one, in the continuous domain), the gain there is the one at
/// the distance 1e-6: what a million samples at resonance make of it.
/// @throws std::invalid_argument the bank's lists do not fit the plant; a filter is not stable; the
///   plant cannot be sampled at the bank's sample time, or a gain or margin is not finite: the
///   entries of plant or filter differ too much in size; what an observer claims cannot be proved
///   (prove_observer()).
void certify(const PlantModel& plant, Bank& bank);

}  // namespace faultline

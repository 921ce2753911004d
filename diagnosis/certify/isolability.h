#pragma once

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// What plant and bank can tell apart.
///
/// Signatures: from `sees` of the bank's filters, for all sets of up to p faults; of a filter with
/// `transient_samples` those in which what it sees in transients has faded.
///
/// Strong isolability: T(λ) = C (λI - A)⁻¹ L + D from faults to outputs, modulo the columns of the
/// decoupled disturbances, in the bank's domain. Fault sets Ω_1, Ω_2 of up to p faults with the
/// right courses look the same for all time iff columns of Ω_1 ∪ Ω_2 are dependent over the
/// rational functions: `confusable` lists the smallest such sets (circuits) of up to 2p faults.
/// Ranks are taken at three complex λ with a fixed seed (a rank is the same at all λ but finitely
/// many, and there it is lower), of columns of unit size.
///
/// At most 200,000 sets are looked at and 1000 listed; then `is_list_complete` is false, and
/// `is_strongly_isolable` is true only if that was proved.
/// @throws std::invalid_argument as domain_model().
[[nodiscard]] IsolabilityCertificate analyse_isolability(const PlantModel& plant, const Bank& bank);

/// Whether the generic signatures of all sets of up to `bank.concurrent` faults differ.
[[nodiscard]] bool are_signatures_distinct(const Bank& bank);

}  // namespace faultline

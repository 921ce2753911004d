#pragma once

#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/design_model.h"

namespace faultline {

/// All sets of p of k faults, lexicographic.
[[nodiscard]] std::vector<FaultSet> combinations(std::size_t k, std::size_t p);

/// What the smallest structure is chosen from: all sets of p faults, and larger ones, which do the
/// work of several: sizes below the number of outputs, those with fewest sets first, up to a
/// thousand sets. By size, then lexicographic.
[[nodiscard]] std::vector<FaultSet> candidate_sets(std::size_t fault_count, std::size_t concurrent,
                                                   std::size_t output_count);

/// The sets that the request's residuals ignore, before "smallest" is chosen among them.
/// @throws InputError an unknown fault, a fault twice in a set, a set twice, all faults ignored.
[[nodiscard]] std::vector<FaultSet> requested_sets(const PlantModel& plant,
                                                   const BankRequest& request);

/// "r12" ignores faults 1 and 2, "r1_12" where fault numbers have two digits, "r0" ignores none.
[[nodiscard]] std::string residual_name(const FaultSet& ignores, std::size_t fault_count);

/// Rows of a structure matrix: per residual, how it sees each fault.
using Structure = std::vector<std::vector<Sensitivity>>;

/// Sets of up to p faults (by size, then lexicographic) with equal generic signatures, in groups of
/// two and more: what the bank cannot tell apart.
[[nodiscard]] std::vector<std::vector<FaultSet>> indistinguishable_sets(const Structure& structure,
                                                                        std::size_t fault_count,
                                                                        std::size_t concurrent);

/// A choice of residuals.
struct ResidualChoice {
  std::vector<std::size_t> residuals;  ///< indices into the structure, sorted
  bool is_proved_smallest = false;
};

/// As few residuals as isolate what all of them do: for any two sets of up to p faults, of which
/// the second is not larger and which all residuals together tell apart, one chosen residual
/// contradicts the second when the first shows its generic signature (it fires and sees no member
/// of the second, or is silent and must fire for it). Because two faults may cancel in a residual,
/// p >= 2 needs every set of p faults ignored by some residual. Smallest hitting set: greedy, then
/// branch and bound of bounded work.
[[nodiscard]] ResidualChoice smallest_structure(const Structure& structure, std::size_t fault_count,
                                                std::size_t concurrent);

}  // namespace faultline

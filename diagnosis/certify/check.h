#pragma once

#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A claim of a bank that does not hold.
struct CheckFinding {
  std::string subject;     ///< name of the residual, or "bank"
  std::string claim;       ///< "gain of u3 at DC"
  std::string stored;      ///< what the bank says
  std::string recomputed;  ///< what plant and filter say
};

/// "r12: gain of u3 at DC: the bank says 1, but it is 0.5".
[[nodiscard]] std::string sentence(const CheckFinding& finding);

/// What became of a bank's claims.
struct CheckResult {
  std::vector<CheckFinding> findings;
  /// Per filter; empty if the bank's lists do not fit the plant.
  std::vector<FilterCertificate> certificates;

  [[nodiscard]] bool holds() const { return findings.empty(); }
};

/// Recomputes every claim of `bank` from the plant and the filters alone. Findings are:
///
/// - another plant: digest, names, fault sizes, operating point, disturbances;
/// - a filter that is not stable, or not named after the faults it ignores (all methods but "uio");
/// - faults, inputs, or disturbances that a residual claims to ignore but sees with more than 10 %
///   of the smallest gain that it must see: per fault size; inputs per size of the fault on them,
///   disturbances per bound, either per unit if it has none;
/// - faults that it sees in another way than `sees` says; a sample count in `forget_samples` that
///   is not the filter's; L and J that are not its response to the faults;
/// - of an observer: matrices and Lipschitz terms that are not those of T, Γ and the plant; bounds
///   that its P, μ do not prove, or that the plant file does not give; β above the least gain in
///   its band (a smaller one is true, too); thresholds, sample by sample, bound and times of its
///   estimate, that are not what is recomputed; of any other filter: such claims at all. Drift
///   bounds need only be positive: thresholds are those without a fault;
/// - of a linear filter with certified thresholds: thresholds and shares that are not what is
///   recomputed, or that nothing proves;
/// - any number of a certificate that differs from the recomputed one by more than 1e-6 of it and
///   more than the rounding errors of its terms, and any difference in `isolability`.
///
/// Names, method, and digest of the request cannot be checked: nothing here depends on them.
/// Never throws for what a bank or plant file may hold: that becomes a finding.
[[nodiscard]] CheckResult check_bank(const PlantModel& plant, const Bank& bank);

}  // namespace faultline

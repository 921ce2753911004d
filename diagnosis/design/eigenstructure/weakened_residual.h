#pragma once

#include <string>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/eigenstructure/compromise.h"
#include "diagnosis/design/eigenstructure/eigenstructure_report.h"
#include "diagnosis/design/geometric.h"

namespace faultline {

/// A residual in which unknown inputs are small.
struct WeakenedResidual {
  GeometricQuotient quotient;  ///< with rows Θ M, Θ H; with left eigenvectors of order p
  GeometricFilter filter;
  WeakeningReport report;
  std::string reason;  ///< why there is none; empty if there is
};

/// Chooses Θ and D_1 on `quotient` by the request's criterion.
///
/// - low_rank, static: Θ by the criterion, with the fewest rows that see all wanted faults unless
/// `rows` says more; its rows become left
///   eigenvectors, Θ M (A_0 + D_1 M) = Λ Θ M, where Θ M A_0 is made of rows of M; else D_1 is that
///   of the poles asked for.
/// - worst_case, rms: Θ by compromises_by_gain() for the poles asked for; with decay_rate_per_s the
///   best of trade_off_gains(), too.
///
/// `task`: of `quotient`. @throws InputError poles that cannot be asked of it
[[nodiscard]] WeakenedResidual weakened_residual(const GeometricQuotient& quotient,
                                                 const CompromiseTask& task,
                                                 const BankRequest& request,
                                                 const std::string& name);

}  // namespace faultline

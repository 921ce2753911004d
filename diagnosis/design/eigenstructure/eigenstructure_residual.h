#pragma once

#include <optional>
#include <string>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/design_model.h"
#include "diagnosis/design/eigenstructure/eigenstructure_report.h"
#include "diagnosis/design/geometric.h"

namespace faultline {

/// A residual by eigenstructure assignment.
struct EigenstructureResidual {
  /// What is left of the plant in it. Left eigenvectors: P = H = W C, A_0 = 0, M = I (static rows
  /// below), so that its F is Λ, of the order of its rows: the other modes of A - K C never show in
  /// r. Right ones: the quotient by the smallest unobservability subspace, which is that by Im E
  /// but for the invariant zeros that r does not see either.
  GeometricQuotient quotient;
  /// F, E where the choice of rows brought the poles along; else they are still to be placed.
  std::optional<GeometricFilter> filter;
  EigenstructureReport report;
  std::string reason;  ///< why there is none; empty if there is, or if the quotient has no row
};

/// The residual that ignores the faults `ignores` and the disturbances `decouple` of the request,
/// and keeps those of `weaken` small.
///
/// A direction (L, D) with an output part: left and right eigenvectors use outputs N y, N D = 0,
/// and ignore L, which is more than is needed where both are not zero; the geometric method is
/// exact there.
/// @throws InputError poles that cannot be asked of it
[[nodiscard]] EigenstructureResidual eigenstructure_residual(const PlantModel& plant,
                                                             const DesignModel& model,
                                                             const BankRequest& request,
                                                             const std::string& name,
                                                             const FaultSet& ignores);

}  // namespace faultline

#pragma once

#include <string>

#include "diagnosis/design/design_model.h"
#include "diagnosis/design/geometric.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Says in words why a residual does not exist, or cannot see a fault.
class FailureExplainer {
 public:
  /// Both must outlive it.
  FailureExplainer(const PlantModel& plant, const DesignModel& model);

  /// Why the residual that ignores `ignores` does not exist (H has no row).
  [[nodiscard]] std::string no_residual(const FaultSet& ignores) const;

  /// Why the residual that ignores `ignores`, with this quotient, cannot see `fault`:
  ///
  /// - the fault reaches no output (S* of no fault contains it);
  /// - without the decoupled disturbances it would be seen;
  /// - its direction depends on the ignored ones: rank [L_1 .. L_p L_j] < p + 1, Corollary 1 of Hou
  ///   2015, which is necessary;
  /// - there is no residual: rank C W* = rank C;
  /// - it lies in S* though Corollary 1 holds, which is not sufficient unless rank C = n.
  [[nodiscard]] std::string unseen(const FaultSet& ignores, std::size_t fault,
                                   const GeometricQuotient& quotient) const;

 private:
  [[nodiscard]] bool has_disturbances() const;

  const PlantModel& plant_;
  const DesignModel& model_;
  DesignModel free_;            ///< without the decoupled disturbances
  GeometricQuotient all_seen_;  ///< of free_, nothing ignored
};

}  // namespace faultline

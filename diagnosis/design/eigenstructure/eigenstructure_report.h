#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/eigenstructure/assignment.h"

namespace faultline {

/// What a compromise of so many rows is worth.
struct RowsTrial {
  Eigen::Index rows = 0;
  double ratio = 0.0;  ///< Compromise::ratio; infinite: these rows miss a fault that is wanted
  double low_rank_cost = 0.0;  ///< ‖Ē - Ē*‖_F with so many singular values removed
};

/// How the unknown inputs were kept small that could not be kept out.
struct WeakeningReport {
  std::string criterion;                ///< "low_rank", "static", "worst_case", "rms"
  std::vector<double> singular_values;  ///< of Ē = [h_d, M b_d], ascending
  Eigen::Index rows = 0;                ///< of the residual
  double approximated = 0.0;            ///< ‖Ē - Ē*‖_F of its own Θ: what it takes for zero
  /// Unknown input to residual over the smallest wanted fault to residual: of all rows as they are
  /// with the poles asked for, and of what was chosen.
  double ratio_before = 0.0, ratio_after = 0.0;
  std::vector<RowsTrial> trade_off;
  std::string gain;  ///< which K: "the poles asked for", "left eigenvectors", ..
};

/// What was done about the unknown inputs of one residual, and why.
struct EigenstructureReport {
  std::string name;        ///< of the residual
  std::string assignment;  ///< "observer" (nothing enters the states), "static", "left", "right",
                           ///< "geometric", "weakened"; empty: none
  std::string explanation;
  /// Of what the residual ignores, on the outputs that this leaves.
  DecouplingExistence existence;
  Eigen::Index static_rows = 0;
  Eigen::MatrixXd W;  ///< of r = W (y - ŷ), rows of length one; 0×q if there is no residual
  std::vector<WeakeningReport> weakening;  ///< one, or none
};

}  // namespace faultline

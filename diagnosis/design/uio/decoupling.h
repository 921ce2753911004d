#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/uio/observer_model.h"

namespace faultline {

/// Directions of unknown inputs that an observer can, and cannot, be made blind to.
struct DecouplableDirections {
  Eigen::MatrixXd D_1;  ///< n×a: rank C D_1 = a
  Eigen::MatrixXd D_2;  ///< n×b: the rest of Im D; C D_2 = 0
};

/// Splits Im D by the singular vectors of C D_h, D_h a factor of full column rank of D: directions,
/// not columns, for columns may be dependent. D n×d, C q×n.
[[nodiscard]] DecouplableDirections split_decouplable(const Eigen::MatrixXd& D,
                                                      const Eigen::MatrixXd& C);

/// T = D_1 (C D_1)⁺, S = I - T C; T = 0 if D_1 has no column. rank C D_1 must be full.
[[nodiscard]] DecouplingMatrices decoupling_matrices(const Eigen::MatrixXd& D_1,
                                                     const Eigen::MatrixXd& C);

/// Columns of D that S annihilates (relative to their size), increasing.
[[nodiscard]] std::vector<std::size_t> annihilated_columns(const Eigen::MatrixXd& S,
                                                           const Eigen::MatrixXd& D);

}  // namespace faultline

#pragma once

#include <Eigen/Core>

namespace faultline {

/// Scales d > 0, powers of two, one per state, such that in coordinates x = diag(d) x̃ the rows and
/// columns of
///
///   [ Ã B̃ ]   [ D⁻¹ A D  D⁻¹ B ]
///   [ C̃ 0 ] = [    C D      0  ]
///
/// have about the same size (columns of B and rows of C count by direction only: their units are
/// free). All ones unless the scales differ by more than a factor of 16: then the coordinates are
/// good enough as they are. A n×n, B n×m, C q×n, finite.
/// Osborne, J. ACM 7 (1960) 338-345, with inputs and outputs.
[[nodiscard]] Eigen::VectorXd state_scales(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                           const Eigen::MatrixXd& C);

/// The power of two nearest to `value`; 1 if that is zero or not finite.
[[nodiscard]] double power_of_two(double value);

}  // namespace faultline

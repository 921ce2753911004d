#pragma once

#include <Eigen/Core>

namespace faultline {

/// Units in which rank decisions are made: x = state ∘ x_b, y = output ∘ y_b (element by element).
/// All are powers of 16, so that changing units costs no digit, and 1 where the plant's own units
/// differ by less: a plant in sane units keeps its coordinates.
struct Balance {
  Eigen::VectorXd state;   ///< n
  Eigen::VectorXd output;  ///< q

  [[nodiscard]] Eigen::MatrixXd of_state(const Eigen::MatrixXd& A) const;   ///< T⁻¹ A T, n×n
  [[nodiscard]] Eigen::MatrixXd of_output(const Eigen::MatrixXd& C) const;  ///< S⁻¹ C T, q×n
};

/// Makes rows and columns of [A L; C 0] equally long, each state's row as long as its column, each
/// output's row as long as the others; the units of the inputs (columns of L) are free.
/// A n×n, C q×n, L n×l. After Osborne, J. ACM 7 (1960) 338-345, as LAPACK's gebal, for systems.
[[nodiscard]] Balance balance(const Eigen::MatrixXd& A, const Eigen::MatrixXd& C,
                              const Eigen::MatrixXd& L);

}  // namespace faultline

#pragma once

#include <Eigen/Core>

namespace faultline {

/// Directions in which signals enter the plant, one per column: `state` n×k, `output` q×k.
struct Directions {
  Eigen::MatrixXd state;
  Eigen::MatrixXd output;
};

/// Units in which rank decisions are made: x = state ∘ x_b, y = output ∘ y_b (element by element).
/// All are powers of 16, so that changing units costs no digit, and 1 where the plant's own units
/// differ by less: a plant in sane units keeps its coordinates.
struct Balance {
  Eigen::VectorXd state;   ///< n
  Eigen::VectorXd output;  ///< q

  [[nodiscard]] Eigen::MatrixXd of_state(const Eigen::MatrixXd& A) const;      ///< T⁻¹ A T, n×n
  [[nodiscard]] Eigen::MatrixXd of_output(const Eigen::MatrixXd& C) const;     ///< S⁻¹ C T, q×n
  [[nodiscard]] Directions of_directions(const Directions& directions) const;  ///< T⁻¹ L, S⁻¹ D
};

/// The units t of states and s of outputs that bring the entries of
///
///   [ T⁻¹ A T   T⁻¹ L W ]
///   [ S⁻¹ C T   S⁻¹ D W ]
///
/// nearest to one size each for A (without its diagonal), C, and [L; D]: least squares of their
/// logarithms over the entries that are not zero, with the units w of the directions free. Whatever
/// units the plant comes in, the balanced plant is the same but for rounding to powers of 16.
/// A n×n, C q×n, `directions` the columns (L_j, D_j). Curtis, Reid, J. Inst. Maths Applics 10
/// (1972) 118-124.
[[nodiscard]] Balance balance(const Eigen::MatrixXd& A, const Eigen::MatrixXd& C,
                              const Directions& directions);

}  // namespace faultline

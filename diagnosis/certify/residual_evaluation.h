#pragma once

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// How a filter's residual is evaluated in the long run, and its threshold then: ‖r‖₂ or ‖Ω r‖₂
/// against τ = J, or max_i |r_i| / r̄_i against τ = 1. Positively homogeneous.
///
/// Of a sequential test r̄_i is the mean that it fires on if it lasts: b_i + κ (CUSUM), b_i + √(2h /
/// window) (GLR).
class ResidualEvaluation {
 public:
  /// Of the filter as it is stored.
  /// @throws std::invalid_argument its course does not fit the rows of its residual.
  explicit ResidualEvaluation(const ResidualFilter& filter);

  /// @param weight Ω, rows×rows.
  /// @param component r̄, rows, positive.
  ResidualEvaluation(Evaluation evaluation, Eigen::MatrixXd weight, Eigen::VectorXd component,
                     double norm);

  [[nodiscard]] double threshold() const { return threshold_; }
  [[nodiscard]] double of(const Eigen::VectorXd& r) const;
  /// The largest value of any r with |r_i| <= rows_i.
  [[nodiscard]] double largest(const Eigen::VectorXd& rows) const;

 private:
  Evaluation evaluation_;
  Eigen::MatrixXd weight_, size_of_weight_;  // empty: Ω = I
  Eigen::VectorXd component_;
  double threshold_;
};

}  // namespace faultline

#pragma once

#include <limits>

#include <Eigen/Core>

namespace faultline {

/// Subspaces of R^n as orthonormal bases (n×dim, dim may be 0) from QR decompositions with column
/// pivoting. A pivot counts as zero when it is at most `tolerance` times the scale given: the size
/// of the data, never that of a computed matrix, which may be pure rounding error.
/// Golub, Van Loan, Matrix Computations, 4th ed., 5.4.
class OrthogonalArithmetic {
 public:
  explicit OrthogonalArithmetic(double tolerance) : tolerance_(tolerance) {}

  /// A subspace and its orthogonal complement.
  struct Split {
    Eigen::MatrixXd inside;   ///< n×dim
    Eigen::MatrixXd outside;  ///< n×(n - dim)
  };

  /// Im X and (Im X)^⊥.
  [[nodiscard]] Split split(const Eigen::MatrixXd& X, double scale);
  /// Ker X.
  [[nodiscard]] Eigen::MatrixXd kernel(const Eigen::MatrixXd& X, double scale);
  /// The shortest s with X s nearest to Y, column by column.
  [[nodiscard]] Eigen::MatrixXd shortest_solution(const Eigen::MatrixXd& X, double scale,
                                                  const Eigen::MatrixXd& Y);

  /// Smallest pivot that counted, largest that did not, relative to their scales.
  [[nodiscard]] double smallest_kept() const { return smallest_kept_; }
  [[nodiscard]] double largest_dropped() const { return largest_dropped_; }

 private:
  [[nodiscard]] Eigen::Index count_pivots(const Eigen::VectorXd& pivots, double scale);

  double tolerance_;
  double smallest_kept_ = std::numeric_limits<double>::infinity();
  double largest_dropped_ = 0.0;
};

/// Orthonormal basis of (Im X)^⊥ for X with orthonormal columns.
[[nodiscard]] Eigen::MatrixXd complement_of(const Eigen::MatrixXd& X);

/// Orthonormal basis of Im X for X of full column rank, whatever the size of its columns.
[[nodiscard]] Eigen::MatrixXd orthonormal_basis(const Eigen::MatrixXd& X);

}  // namespace faultline

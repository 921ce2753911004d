#pragma once

#include <limits>

#include <Eigen/Core>

namespace faultline {

/// Singular values below this fraction of the data's scale count as zero. The geometric mean of
/// 1e-6 .. 1e-12, the range over which a design's dimensions are to be stable: data are rarely good
/// to 1e-6, and rounding errors of these algorithms stay below 1e-12.
inline constexpr double kRankTolerance = 1e-9;

/// How far a computation's rank decisions were from flipping, relative to the data's scale.
struct RankMargin {
  double smallest_kept = std::numeric_limits<double>::infinity();
  double largest_dropped = 0.0;
};

/// Subspaces of R^n as orthonormal bases (n×dim, dim may be 0), and the rank decisions made on the
/// way. Singular values count relative to the data's scale, never to the largest singular value of
/// a computed matrix, which may be pure rounding error.
class SubspaceArithmetic {
 public:
  explicit SubspaceArithmetic(double tolerance = kRankTolerance) : tolerance_(tolerance) {}

  /// Im X. `scale`: size of the data X came from; singular values <= tolerance·scale are zero.
  [[nodiscard]] Eigen::MatrixXd image(const Eigen::MatrixXd& X, double scale);
  /// Ker X.
  [[nodiscard]] Eigen::MatrixXd kernel(const Eigen::MatrixXd& X, double scale);
  /// U + V.
  [[nodiscard]] Eigen::MatrixXd sum(const Eigen::MatrixXd& U, const Eigen::MatrixXd& V);
  /// U ∩ V, as the complement of the sum of the complements.
  [[nodiscard]] Eigen::MatrixXd intersection(const Eigen::MatrixXd& U, const Eigen::MatrixXd& V);
  /// A⁻¹ Z = {x: A x ∈ Z}, the pre-image; A may be singular. `scale`: size of A.
  [[nodiscard]] Eigen::MatrixXd preimage(const Eigen::MatrixXd& A, const Eigen::MatrixXd& Z,
                                         double scale);
  /// Moore-Penrose pseudo-inverse of X.
  [[nodiscard]] Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& X, double scale);

  [[nodiscard]] const RankMargin& margin() const { return margin_; }

 private:
  [[nodiscard]] Eigen::Index rank(const Eigen::VectorXd& singular_values, double scale);

  double tolerance_;
  RankMargin margin_;
};

/// Orthogonal complement of an orthonormal basis.
[[nodiscard]] Eigen::MatrixXd complement(const Eigen::MatrixXd& basis);

/// Orthonormal rows that span the `dimension`-dimensional subspace with orthogonal projector
/// `projector`. They depend on the subspace only (not on the basis it came from), so that designs
/// reproduce: Gram-Schmidt on the projector's columns, longest first; the largest entry of each row
/// is positive.
[[nodiscard]] Eigen::MatrixXd canonical_rows(const Eigen::MatrixXd& projector,
                                             Eigen::Index dimension);

}  // namespace faultline

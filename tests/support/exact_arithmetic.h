#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace faultline {

/// A matrix over the integers modulo the prime 2^61 - 1: ranks without a tolerance. The rank of a
/// matrix of whole numbers is that over the rationals unless the prime divides its minors; with the
/// small entries of the tests they are smaller than the prime, or do so with probability 4e-19.
class ExactMatrix {
 public:
  ExactMatrix(Eigen::Index rows, Eigen::Index cols);  ///< zeros
  /// Precondition: whole numbers below 2^53 in size.
  explicit ExactMatrix(const Eigen::MatrixXd& whole_numbers);

  [[nodiscard]] Eigen::Index rows() const { return rows_; }
  [[nodiscard]] Eigen::Index cols() const { return cols_; }
  [[nodiscard]] std::uint64_t at(Eigen::Index i, Eigen::Index j) const {
    return values_[static_cast<std::size_t>(i * cols_ + j)];
  }
  std::uint64_t& at(Eigen::Index i, Eigen::Index j) {
    return values_[static_cast<std::size_t>(i * cols_ + j)];
  }

 private:
  Eigen::Index rows_, cols_;
  std::vector<std::uint64_t> values_;  // row by row
};

[[nodiscard]] ExactMatrix operator*(const ExactMatrix& X, const ExactMatrix& Y);
[[nodiscard]] ExactMatrix side_by_side(const ExactMatrix& X, const ExactMatrix& Y);
[[nodiscard]] ExactMatrix stacked(const ExactMatrix& X, const ExactMatrix& Y);
[[nodiscard]] ExactMatrix transpose(const ExactMatrix& X);
[[nodiscard]] Eigen::Index rank(const ExactMatrix& X);
/// A basis of Im X: columns of X.
[[nodiscard]] ExactMatrix image(const ExactMatrix& X);
/// A basis of Ker X.
[[nodiscard]] ExactMatrix kernel(const ExactMatrix& X);

/// W* and S* of (C, A) for L, as bases.
struct ExactSubspaces {
  ExactMatrix W, S;
};
[[nodiscard]] ExactSubspaces exact_unobservability_subspaces(const ExactMatrix& A,
                                                             const ExactMatrix& C,
                                                             const ExactMatrix& L);

/// C (λ I - A)⁻¹ B + D at a whole λ that is no eigenvalue of A (else the test aborts).
[[nodiscard]] ExactMatrix exact_transfer(const ExactMatrix& A, const ExactMatrix& B,
                                         const ExactMatrix& C, const ExactMatrix& D,
                                         std::uint64_t lambda);

}  // namespace faultline

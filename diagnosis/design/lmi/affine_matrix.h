#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>

namespace faultline {

/// A matrix whose entries are affine in the real variables x of an LMI problem:
///
///   E(x) = E_0 + Σ_k x_k E_k
///
/// E_k are sparse and may be complex. What can be written with +, products with constant matrices,
/// adjoints and blocks is one; a product of two of them is not.
class AffineMatrix {
 public:
  /// Entry (row, col) of E_variable; of E_0 if `variable` is kConstant.
  struct Term {
    Eigen::Index variable = 0;
    Eigen::Index row = 0;
    Eigen::Index col = 0;
    std::complex<double> value;
  };
  static constexpr Eigen::Index kConstant = -1;

  /// Zero.
  AffineMatrix(Eigen::Index rows, Eigen::Index cols) : rows_(rows), cols_(cols) {}
  /// The constant E_0. Not explicit: constants mix with variables as in the equations.
  AffineMatrix(const Eigen::MatrixXd& constant);  // NOLINT(google-explicit-constructor)
  /// Terms in any order; those of one entry are added.
  AffineMatrix(Eigen::Index rows, Eigen::Index cols, std::vector<Term> terms);

  [[nodiscard]] Eigen::Index rows() const { return rows_; }
  [[nodiscard]] Eigen::Index cols() const { return cols_; }
  /// By variable, column, row; no two for one entry; none zero.
  [[nodiscard]] const std::vector<Term>& terms() const { return terms_; }

  /// Eᴴ.
  [[nodiscard]] AffineMatrix adjoint() const;
  /// E(x). @pre x has an entry for every variable that enters
  [[nodiscard]] Eigen::MatrixXcd at(const Eigen::VectorXd& x) const;

  /// @pre of all that follow: shapes that fit
  AffineMatrix& operator+=(const AffineMatrix& other);
  friend AffineMatrix operator+(AffineMatrix a, const AffineMatrix& b) { return a += b; }
  friend AffineMatrix operator-(AffineMatrix a, const AffineMatrix& b) { return a += -b; }
  friend AffineMatrix operator-(const AffineMatrix& a) { return -1.0 * a; }
  friend AffineMatrix operator*(std::complex<double> factor, const AffineMatrix& a);
  friend AffineMatrix operator*(const Eigen::MatrixXd& left, const AffineMatrix& right);
  friend AffineMatrix operator*(const AffineMatrix& left, const Eigen::MatrixXd& right);

 private:
  void normalise();

  Eigen::Index rows_;
  Eigen::Index cols_;
  std::vector<Term> terms_;
};

/// E + Eᴴ.
[[nodiscard]] AffineMatrix hermitian_part_twice(const AffineMatrix& a);

/// x M, with x a 1×1 affine matrix.
[[nodiscard]] AffineMatrix multiple_of(const Eigen::MatrixXd& M, const AffineMatrix& scalar);

/// diag(x), with x an affine n×1 matrix.
[[nodiscard]] AffineMatrix diagonal(const AffineMatrix& column);

/// [a_1 a_2 ..].
[[nodiscard]] AffineMatrix beside(const std::vector<AffineMatrix>& blocks);

/// The Hermitian matrix whose upper block rows are given, completed below the diagonal by adjoints:
/// `upper[i]` = blocks (i, i), (i, i+1), ... Blocks without rows or columns are allowed.
[[nodiscard]] AffineMatrix hermitian(const std::vector<std::vector<AffineMatrix>>& upper);

}  // namespace faultline

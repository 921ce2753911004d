#pragma once

#include <complex>
#include <functional>

#include <Eigen/Core>

namespace faultline {

/// A = U T Uᴴ with T upper triangular, U unitary.
struct ComplexTriangle {
  Eigen::MatrixXcd U;
  Eigen::MatrixXcd T;
};

/// The complex Schur form of A, n×n, finite. Here, and not where it is used, because each use of
/// Eigen's Schur decomposition costs its file ten seconds of compilation.
/// @throws std::invalid_argument the iteration does not converge.
[[nodiscard]] ComplexTriangle complex_schur(const Eigen::MatrixXd& A);

/// Swaps neighbours on the diagonal of T until `key(eigenvalue)` does not fall along it, so that
/// the first columns of U span the invariant subspace of the eigenvalues with the smallest keys.
/// Golub, Van Loan, Matrix Computations, 4th ed., 7.6.2.
void sort_triangle(ComplexTriangle& triangle,
                   const std::function<double(std::complex<double>)>& key);

}  // namespace faultline

#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/subspace.h"

namespace faultline {

/// The part of x' = A x, y = C x that y tells of, and the rest, which no output injection moves.
struct ObservablePart {
  Eigen::MatrixXd basis;  ///< n×d, orthonormal: complement of the unobservable subspace
  Eigen::MatrixXd A;      ///< d×d: basisᵀ A basis
  Eigen::MatrixXd C;      ///< q×d: C basis
  std::vector<std::complex<double>> unobservable;  ///< eigenvalues of the rest, n - d of them
};

/// U_0 = Ker C, U_i+1 = Ker C ∩ A⁻¹ U_i until it stands: the unobservable subspace. A n×n, C q×n.
/// W. M. Wonham, Linear Multivariable Control, 3rd ed., 1985, section 3.2.
[[nodiscard]] ObservablePart observable_part(const Eigen::MatrixXd& A, const Eigen::MatrixXd& C,
                                             SubspaceArithmetic& arithmetic);

}  // namespace faultline

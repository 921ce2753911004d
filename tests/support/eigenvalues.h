#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>

namespace faultline {

/// Eigenvalues of F by real part, then imaginary part. For all tests in one file: each use of
/// Eigen's eigenvalue solver costs ten seconds of compilation.
[[nodiscard]] std::vector<std::complex<double>> sorted_eigenvalues(const Eigen::MatrixXd& F);

}  // namespace faultline

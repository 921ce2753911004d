#include "diagnosis/certify/spectra.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

namespace faultline {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

double largest_eigenvalue(const MatrixXd& X) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(X, Eigen::EigenvaluesOnly);
  return solver.eigenvalues()[X.rows() - 1];
}

// [Re -Im; Im Re] has every singular value of X twice.
double smallest_singular_value(const MatrixXcd& X) {
  if (X.cols() == 1) return X.norm();
  MatrixXd real(2 * X.rows(), 2 * X.cols());
  real << X.real(), -X.imag(), X.imag(), X.real();
  const Eigen::JacobiSVD<MatrixXd> svd(real);
  return svd.singularValues()[real.cols() - 1];
}

}  // namespace faultline

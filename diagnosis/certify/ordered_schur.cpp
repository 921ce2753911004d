#include "diagnosis/certify/ordered_schur.h"

#include <complex>
#include <stdexcept>
#include <utility>
#include <vector>

#include <Eigen/Eigenvalues>

namespace faultline {

using Eigen::Index;

ComplexTriangle complex_schur(const Eigen::MatrixXd& A) {
  if (A.size() == 0) {
    return {Eigen::MatrixXcd(0, 0), Eigen::MatrixXcd(0, 0)};
  }
  const Eigen::ComplexSchur<Eigen::MatrixXd> schur(A);
  if (schur.info() != Eigen::Success) {
    throw std::invalid_argument("the eigenvalues of a matrix cannot be found");
  }
  return {schur.matrixU(), schur.matrixT()};
}

void sort_triangle(ComplexTriangle& triangle,
                   const std::function<double(std::complex<double>)>& key) {
  Eigen::MatrixXcd& T = triangle.T;
  const Index n = T.rows();
  std::vector<double> keys;
  for (Index i = 0; i < n; ++i) {
    keys.push_back(key(T(i, i)));
  }
  for (Index last = n - 1; last > 0; --last) {
    for (Index i = 0; i < last; ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (keys[at] <= keys[at + 1]) {
        continue;
      }
      std::swap(keys[at], keys[at + 1]);
      Eigen::JacobiRotation<std::complex<double>> rotation;
      rotation.makeGivens(T(i, i + 1), T(i + 1, i + 1) - T(i, i));
      T.applyOnTheLeft(i, i + 1, rotation.adjoint());
      T.applyOnTheRight(i, i + 1, rotation);
      T(i + 1, i) = 0.0;
      triangle.U.applyOnTheRight(i, i + 1, rotation);
    }
  }
}

}  // namespace faultline

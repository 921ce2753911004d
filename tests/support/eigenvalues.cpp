#include "tests/support/eigenvalues.h"

#include <algorithm>
#include <utility>

#include <Eigen/Eigenvalues>

namespace faultline {

std::vector<std::complex<double>> sorted_eigenvalues(const Eigen::MatrixXd& F) {
  const Eigen::VectorXcd values = F.eigenvalues();
  std::vector<std::complex<double>> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) {
    return std::pair(a.real(), a.imag()) < std::pair(b.real(), b.imag());
  });
  return sorted;
}

}  // namespace faultline

#include "diagnosis/bank/bank.h"

#include <limits>

#include <Eigen/Eigenvalues>

namespace faultline {

std::string_view domain_name(DesignDomain domain) noexcept {
  switch (domain) {
    case DesignDomain::kSampled:
      return "sampled";
    case DesignDomain::kEuler:
      return "euler";
    case DesignDomain::kContinuous:
      break;
  }
  return "continuous";
}

Eigen::Index Bank::residual_rows() const {
  Eigen::Index rows = 0;
  for (const ResidualFilter& filter : filters) {
    rows += filter.H.rows();
  }
  return rows;
}

std::size_t fault_set_count(std::size_t fault_count, std::size_t concurrent) noexcept {
  constexpr std::size_t kMost = std::numeric_limits<std::size_t>::max();
  std::size_t count = 1;
  std::size_t binomial = 1;
  for (std::size_t i = 1; i <= concurrent && i <= fault_count; ++i) {
    // C(k, i) = C(k, i-1) (k-i+1) / i, exactly.
    if (binomial > kMost / (fault_count - i + 1)) {
      return kMost;
    }
    binomial = binomial * (fault_count - i + 1) / i;
    if (count > kMost - binomial) {
      return kMost;
    }
    count += binomial;
  }
  return count;
}

Eigen::VectorXcd eigenvalues(const Eigen::MatrixXd& F) {
  if (F.size() == 0) {
    return {};
  }
  return F.eigenvalues();
}

double spectral_radius(const Eigen::MatrixXd& F) {
  return F.size() == 0 ? 0.0 : eigenvalues(F).cwiseAbs().maxCoeff();
}

}  // namespace faultline

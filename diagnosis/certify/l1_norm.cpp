#include "diagnosis/certify/l1_norm.h"

#include <optional>
#include <stdexcept>

#include "diagnosis/certify/power_bound.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;

constexpr double kNegligible = 1e-9;
constexpr long kMaxSamples = 10'000'000;

[[noreturn]] void refuse() {
  throw std::invalid_argument("its filter is not stable, or forgets too slowly");
}

}  // namespace

MatrixXd l1_norm(const StableSystem& system) {
  MatrixXd sum = system.D.cwiseAbs();
  if (system.A.rows() == 0 || system.B.cols() == 0) return sum;
  const std::optional<double> power_sum = power_sum_bound(system.A);
  if (!power_sum) refuse();
  const double size = system.B.norm();
  MatrixXd left = system.C;  // C A^k
  for (long k = 0; k < kMaxSamples; ++k) {
    const double rest = left.norm() * *power_sum;
    if (rest * size <= kNegligible * sum.maxCoeff() || rest * size == 0.0) {
      sum.rowwise() += rest * system.B.colwise().norm();
      return sum;
    }
    sum += (left * system.B).cwiseAbs();
    left = (left * system.A).eval();
  }
  refuse();
}

}  // namespace faultline

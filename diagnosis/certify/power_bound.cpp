#include "diagnosis/certify/power_bound.h"

#include <algorithm>

namespace faultline {
namespace {

using Eigen::MatrixXd;

// F^(2^20) is beyond the longest time that is looked at.
constexpr int kMostSquarings = 20;
constexpr int kMaxDoublings = 24;  // 16 million samples

}  // namespace

// F^(2^s) is a contraction from some s on, and every power below it is a product of squares.
double largest_power(const MatrixXd& F) {
  MatrixXd power = F;
  double bound = std::max(1.0, MatrixXd::Identity(F.rows(), F.cols()).norm());
  for (int s = 0; s < kMostSquarings && power.norm() >= 1.0; ++s) {
    bound *= std::max(1.0, power.norm());
    power = (power * power).eval();
  }
  return bound;
}

// With t = 2^s the first for which ‖F^t‖ < 1/2, the powers up to t are bounded by the products of
// those of the binary digits, and the rest is a geometric series.
std::optional<double> power_sum_bound(const MatrixXd& F) {
  double largest = std::max(1.0, MatrixXd::Identity(F.rows(), F.cols()).norm());
  double t = 1.0;
  MatrixXd power = F;
  for (int s = 0; s < kMaxDoublings; ++s) {
    const double norm = power.norm();
    if (norm < 0.5) {
      return 2.0 * t * largest;
    }
    largest *= std::max(1.0, norm);
    t *= 2.0;
    power = (power * power).eval();
  }
  return std::nullopt;
}

}  // namespace faultline

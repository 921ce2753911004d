#include "diagnosis/runtime/sequential_step.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace faultline {
namespace {

// A CUSUM stops here, in thresholds: after a fault it takes h / κ samples to clear.
constexpr double kLimit = 2.0;

}  // namespace

SequentialStatistic::SequentialStatistic(const ResidualFilter& filter)
    : kind_(filter.test->kind),
      reference_(filter.test->reference),
      limit_(kLimit * filter.threshold),
      offset_(filter.test->offset) {
  const auto rows = static_cast<std::size_t>(filter.H.rows());
  if (kind_ == TestKind::kGlr) {
    window_ = std::max<std::size_t>(filter.test->window, 1);
    recent_.resize(rows * window_);
  } else {
    up_.resize(rows);
    down_.resize(rows);
  }
}

double SequentialStatistic::step(std::span<const double> r) noexcept {
  const double statistic = kind_ == TestKind::kGlr ? step_glr(r) : step_cusum(r);
  const bool is_nan = std::any_of(r.begin(), r.end(), [](double x) { return std::isnan(x); });
  return is_nan ? std::numeric_limits<double>::quiet_NaN() : statistic;
}

void SequentialStatistic::restart() noexcept {
  std::fill(up_.begin(), up_.end(), 0.0);
  std::fill(down_.begin(), down_.end(), 0.0);
  count_ = next_ = 0;
}

double SequentialStatistic::step_cusum(std::span<const double> r) noexcept {
  double largest = 0.0;
  for (std::size_t i = 0; i < r.size(); ++i) {
    const double allowed = offset_[i] + reference_;
    up_[i] = std::min(std::max(0.0, up_[i] + r[i] - allowed), limit_);
    down_[i] = std::min(std::max(0.0, down_[i] - r[i] - allowed), limit_);
    largest = std::max({largest, up_[i], down_[i]});
  }
  return largest;
}

double SequentialStatistic::step_glr(std::span<const double> r) noexcept {
  for (std::size_t i = 0; i < r.size(); ++i) recent_[i * window_ + next_] = r[i];
  next_ = next_ + 1 == window_ ? 0 : next_ + 1;
  count_ = std::min(count_ + 1, window_);
  double largest = 0.0;
  for (std::size_t i = 0; i < r.size(); ++i) largest = std::max(largest, likelihood(i));
  return largest;
}

// max_j max(0, |sum of the last j| - j b)² / (2 j)
double SequentialStatistic::likelihood(std::size_t row) const noexcept {
  const double* const ring = recent_.data() + row * window_;
  double largest = 0.0;
  double sum = 0.0;
  std::size_t at = next_;
  for (std::size_t j = 1; j <= count_; ++j) {
    at = at == 0 ? window_ - 1 : at - 1;
    sum += ring[at];
    const auto length = static_cast<double>(j);
    const double above = std::max(0.0, std::abs(sum) - length * offset_[row]);
    largest = std::max(largest, above * above / (2.0 * length));
  }
  return largest;
}

}  // namespace faultline

#include "tools/report/envelope_series.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace faultline {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

/// The nearest float that is not above, or not below, `value`. Beyond the range of float: its ends
/// and the infinities.
float rounded_down(double value) {
  const auto nearest = static_cast<float>(value);
  return static_cast<double>(nearest) <= value
             ? nearest
             : std::nextafter(nearest, -std::numeric_limits<float>::infinity());
}
float rounded_up(double value) {
  const auto nearest = static_cast<float>(value);
  return static_cast<double>(nearest) >= value
             ? nearest
             : std::nextafter(nearest, std::numeric_limits<float>::infinity());
}

}  // namespace

void EnvelopeSeries::add(std::int64_t cycle, double value) {
  if (std::isnan(value)) return;
  last_ = cycle = std::max(cycle, last_);
  if (count_ == 0) {
    peak_cycle_ = cycle;
    smallest_ = largest_ = value;
  }
  // Unsigned: the distance of any two cycles fits.
  const auto distance = static_cast<std::uint64_t>(cycle) - static_cast<std::uint64_t>(origin_);
  while ((distance >> shift_) >= kMostBuckets) halve();
  const auto index = static_cast<std::size_t>(distance >> shift_);
  if (index >= low_.size()) {
    low_.resize(index + 1, kNone);
    high_.resize(index + 1, kNone);
  }
  // fmin and fmax take the number where the other is none.
  low_[index] = std::fmin(low_[index], rounded_down(value));
  high_[index] = std::fmax(high_[index], rounded_up(value));
  if (std::abs(value) > std::max(std::abs(smallest_), std::abs(largest_))) peak_cycle_ = cycle;
  smallest_ = std::min(smallest_, value);
  largest_ = std::max(largest_, value);
  ++count_;
}

void EnvelopeSeries::halve() {
  const std::size_t half = (low_.size() + 1) / 2;
  for (std::size_t i = 0; i < half; ++i) {
    const std::size_t first = 2 * i;
    const std::size_t second = std::min(first + 1, low_.size() - 1);
    low_[i] = std::fmin(low_[first], low_[second]);
    high_[i] = std::fmax(high_[first], high_[second]);
  }
  low_.resize(half);
  high_.resize(half);
  ++shift_;
}

void EnvelopeSeries::widen_to(int shift) {
  while (shift_ < shift) halve();
}

bool EnvelopeSeries::is_constant() const noexcept {
  return count_ > 0 && smallest_ == largest_ &&
         std::none_of(low_.begin(), low_.end(), [](float low) { return std::isnan(low); });
}

}  // namespace faultline

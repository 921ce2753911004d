#include "drivers/signal/period_statistics.h"

#include <algorithm>
#include <cmath>
#include <variant>

namespace faultline {
namespace {

constexpr double kNanosecondsPerSecond = 1e9;
constexpr double kNanosecondsPerMillisecond = 1e6;
/// Nothing on a bus is sent less often.
constexpr std::chrono::hours kLongestPeriod(24);

/// The time from `from` to `to`, as much of it as nanoseconds hold: stamps of a broken log may be
/// centuries apart. @pre from <= to
std::chrono::nanoseconds time_between(Timestamp from, Timestamp to) noexcept {
  std::int64_t gap_ns = 0;
  const bool is_too_long = __builtin_sub_overflow(to.time_since_epoch().count(),
                                                  from.time_since_epoch().count(), &gap_ns);
  return is_too_long ? std::chrono::nanoseconds::max() : std::chrono::nanoseconds(gap_ns);
}

double seconds(std::chrono::nanoseconds time) noexcept {
  return static_cast<double>(time.count()) / kNanosecondsPerSecond;
}

}  // namespace

std::chrono::nanoseconds period_of(const DbcDatabase& dbc, const DbcMessage& message) {
  const DbcAttributeValue* const value = dbc.attribute_of(message, kCycleTimeAttribute);
  if (value == nullptr) return {};
  double period_ms = 0.0;
  if (const auto* const integer = std::get_if<std::int64_t>(value)) {
    period_ms = static_cast<double>(*integer);
  } else if (const auto* const number = std::get_if<double>(value)) {
    period_ms = *number;
  }
  constexpr std::chrono::duration<double, std::milli> kLongest = kLongestPeriod;
  if (!(period_ms > 0.0) || period_ms > kLongest.count()) return {};
  return std::chrono::nanoseconds(std::llround(period_ms * kNanosecondsPerMillisecond));
}

void PeriodStatistics::add(Timestamp stamp) noexcept {
  const Timestamp before = last_;
  last_ = stamp;
  ++frames_;
  if (frames_ == 1) return;
  if (stamp < before) {
    ++backward_;
    return;
  }
  const std::chrono::nanoseconds gap = time_between(before, stamp);
  ++intervals_;
  least_ = intervals_ == 1 ? gap : std::min(least_, gap);
  greatest_ = std::max(greatest_, gap);
  const double gap_s = seconds(gap);
  const double from_mean_s = gap_s - mean_s_;
  mean_s_ += from_mean_s / static_cast<double>(intervals_);
  squares_s2_ += from_mean_s * (gap_s - mean_s_);
  if (has_period()) compare_with_period(gap);
}

void PeriodStatistics::compare_with_period(std::chrono::nanoseconds gap) noexcept {
  const double periods = static_cast<double>(gap.count()) / static_cast<double>(period_.count());
  const double deviation = periods - 1.0;
  const auto* const edge = std::upper_bound(kJitterEdges.begin(), kJitterEdges.end(), deviation);
  ++jitter_[static_cast<std::size_t>(edge - kJitterEdges.begin())];
  if (periods < kEarly) ++early_;
  if (periods > kLate) {
    ++late_;
    lost_ += static_cast<std::uint64_t>(std::llround(periods)) - 1;
  }
}

double PeriodStatistics::deviation_s() const noexcept {
  return intervals_ == 0 ? 0.0 : std::sqrt(squares_s2_ / static_cast<double>(intervals_));
}

}  // namespace faultline

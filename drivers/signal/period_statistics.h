#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "drivers/can/can_frame.h"
#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// Vector's attribute of a message: its period in milliseconds; 0: not periodic.
inline constexpr std::string_view kCycleTimeAttribute = "GenMsgCycleTime";

/// Period of `message` as the DBC gives it; zero if it gives none, or one that is no positive
/// number (up to a day).
[[nodiscard]] std::chrono::nanoseconds period_of(const DbcDatabase& dbc, const DbcMessage& message);

/// Times between the frames of one identifier against its period T.
///
/// g is the time from one frame to the next. Without T only g's minimum, mean, maximum and
/// deviation are kept. A stamp before the last one (a clock that was set) gives no g: it is counted
/// and the times go on from there. Does not allocate.
class PeriodStatistics {
 public:
  static constexpr double kEarly = 0.5;  ///< g < kEarly·T: early
  static constexpr double kLate = 1.5;   ///< g > kLate·T: late

  /// Bin n of the histogram counts the deviations g/T - 1 in [edge n-1, edge n); the first has no
  /// lower edge (early), the last no upper one (late, and g = kLate·T).
  static constexpr std::array<double, 12> kJitterEdges{-0.5, -0.2, -0.1, -0.05, -0.02, -0.01,
                                                       0.01, 0.02, 0.05, 0.1,   0.2,   0.5};
  using JitterHistogram = std::array<std::uint64_t, kJitterEdges.size() + 1>;

  /// @param period T; zero or less: not known
  explicit PeriodStatistics(std::chrono::nanoseconds period = {}) noexcept : period_(period) {}

  /// The next frame came at `stamp`.
  void add(Timestamp stamp) noexcept;
  void reset() noexcept { *this = PeriodStatistics(period_); }

  [[nodiscard]] bool has_period() const noexcept { return period_.count() > 0; }
  [[nodiscard]] std::chrono::nanoseconds period() const noexcept { return period_; }

  [[nodiscard]] std::uint64_t frames() const noexcept { return frames_; }
  /// Times g measured: one less than frames and backward stamps.
  [[nodiscard]] std::uint64_t intervals() const noexcept { return intervals_; }
  [[nodiscard]] std::uint64_t backward() const noexcept { return backward_; }

  // Of g; zero while there are no intervals.
  [[nodiscard]] std::chrono::nanoseconds least() const noexcept { return least_; }
  [[nodiscard]] std::chrono::nanoseconds greatest() const noexcept { return greatest_; }
  [[nodiscard]] double mean_s() const noexcept { return mean_s_; }
  /// Square root of the mean squared deviation from the mean.
  [[nodiscard]] double deviation_s() const noexcept;

  // Zero without a period.
  [[nodiscard]] std::uint64_t early() const noexcept { return early_; }
  [[nodiscard]] std::uint64_t late() const noexcept { return late_; }
  /// Frames that should have come: the sum of round(g/T) - 1 over the g > kLate·T.
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }
  [[nodiscard]] const JitterHistogram& jitter() const noexcept { return jitter_; }

 private:
  void compare_with_period(std::chrono::nanoseconds gap) noexcept;

  std::chrono::nanoseconds period_;
  Timestamp last_{};
  std::uint64_t frames_ = 0;
  std::uint64_t intervals_ = 0;
  std::uint64_t backward_ = 0;
  std::uint64_t early_ = 0;
  std::uint64_t late_ = 0;
  std::uint64_t lost_ = 0;
  std::chrono::nanoseconds least_{};
  std::chrono::nanoseconds greatest_{};
  double mean_s_ = 0.0;
  double squares_s2_ = 0.0;  ///< sum of squared deviations from the mean (Welford)
  JitterHistogram jitter_{};
};

}  // namespace faultline

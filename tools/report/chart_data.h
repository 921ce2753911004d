#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tools/report/envelope_series.h"
#include "tools/report/run_record.h"

namespace faultline {

/// One line of a chart: an envelope, or points with bands.
struct ChartSeries {
  std::string label;
  std::size_t run = 0;  ///< which of the runs of the page: its colour
  bool is_threshold = false;
  double sign = 1.0;           ///< of the envelope's values: -1 draws -τ
  double sample_time_s = 1.0;  ///< of the envelope
  EnvelopeSeries values{0};
  /// Of estimates, instead of the envelope: time, value - band, value, value + band.
  std::vector<std::array<double, 4>> points{};
};

struct Chart {
  std::string title;
  std::string unit;     ///< may be empty
  std::string summary;  ///< what the picture shows, in words
  std::vector<ChartSeries> series{};
  bool has_bands = false;  ///< its series are points
  /// Per run: from, until in seconds, while the residual fired.
  std::vector<std::vector<std::array<double, 2>>> fired{};
  /// Stretches with faults, where they are not those of the page.
  std::optional<std::vector<std::array<double, 2>>> faults{};
};

/// The charts of a page and the data that they draw. The page may be `most_bytes` long in data:
/// where it would be longer, the longest series are merged bucket by bucket, which loses times but
/// no extremes.
class ChartData {
 public:
  explicit ChartData(std::size_t most_bytes = kMostBytes) : most_bytes_(most_bytes) {}

  /// @return the element that shows the chart.
  std::string add(Chart chart);

  /// The data as JSON, for report.js.
  /// @param window from, until in seconds: all that there is
  /// @param faults stretches in seconds in which faults acted
  [[nodiscard]] std::string json(std::array<double, 2> window,
                                 const std::vector<std::array<double, 2>>& faults);

  [[nodiscard]] bool is_empty() const noexcept { return charts_.empty(); }

  /// An hour at 100 Hz stays below 5 MB with it, whatever the number of signals.
  static constexpr std::size_t kMostBytes = 4'000'000;

 private:
  void shrink();

  std::size_t most_bytes_;
  std::vector<Chart> charts_;
};

/// IEEE 754 single precision, little-endian, in base64 (RFC 4648, section 4).
[[nodiscard]] std::string base64_floats(const std::vector<float>& values);

/// Stretches of cycles in seconds; those nearer to each other than `least_gap_s` are joined.
[[nodiscard]] std::vector<std::array<double, 2>> stretches_s(const std::vector<CycleRange>& ranges,
                                                             double sample_time_s,
                                                             double least_gap_s);

}  // namespace faultline

#include "tools/report/chart_data.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/report/html_text.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

/// A line with so few steps is stored as its corners.
constexpr std::size_t kMostCorners = 400;

/// Lowest and highest of a bucket are one value, but for their rounding outwards.
bool is_level(float low, float high) { return low == high || std::nextafter(low, high) == high; }

Json finite_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

/// The corners of a line that keeps its value for long, as [time, value] pairs; nothing if it is
/// no such line.
std::optional<Json> corners_of(const ChartSeries& series) {
  const EnvelopeSeries& values = series.values;
  const double bucket_s = std::ldexp(series.sample_time_s, values.shift());
  const double from_s = static_cast<double>(values.origin()) * series.sample_time_s;
  Json corners = Json::array();
  std::size_t first = 0;
  const auto& high = values.high();
  for (std::size_t i = 0; i <= high.size(); ++i) {
    if (i < high.size() && !is_level(values.low()[i], high[i])) return std::nullopt;
    if (i > first && (i == high.size() || high[i] != high[first])) {
      const double value = series.sign * static_cast<double>(high[first]);
      if (!std::isfinite(value)) return std::nullopt;
      corners.push_back({from_s + static_cast<double>(first) * bucket_s, value});
      corners.push_back({from_s + static_cast<double>(i) * bucket_s, value});
      if (corners.size() > kMostCorners) return std::nullopt;
      first = i;
    }
  }
  return corners;
}

std::size_t bytes_of(const EnvelopeSeries& values) {
  constexpr std::size_t kPerFloat = 6;  // 16/3 in base64
  return values.low().size() * kPerFloat * (values.shift() == 0 ? 1 : 2);
}

std::vector<float> negated(std::vector<float> values) {
  for (float& value : values) value = -value;
  return values;
}

Json series_json(const ChartSeries& series, bool has_bands) {
  const EnvelopeSeries& values = series.values;
  Json json{{"label", series.label},
            {"run", series.run},
            {"role", series.is_threshold ? "threshold" : "line"}};
  const double from_s = static_cast<double>(values.origin()) * series.sample_time_s;
  const double bucket_s = std::ldexp(series.sample_time_s, values.shift());
  if (has_bands) {
    json["kind"] = "points";
    json["points"] = Json::array();
    for (const auto& [t_s, low, value, high] : series.points) {
      json["points"].push_back(
          {t_s, {finite_or_null(low), finite_or_null(value), finite_or_null(high)}});
    }
  } else if (values.is_constant() && std::isfinite(values.largest())) {
    json["kind"] = "constant";
    json["value"] = series.sign * values.largest();
    json["from_s"] = from_s;
    json["until_s"] = from_s + static_cast<double>(values.low().size()) * bucket_s;
  } else if (const auto corners = corners_of(series)) {
    json["kind"] = "points";
    json["points"] = *corners;
  } else {
    json["kind"] = "envelope";
    json["from_s"] = from_s;
    json["bucket_s"] = bucket_s;
    const bool is_negative = series.sign < 0.0;
    json["high"] = base64_floats(is_negative ? negated(values.low()) : values.high());
    if (values.shift() > 0) {
      json["low"] = base64_floats(is_negative ? negated(values.high()) : values.low());
    }
  }
  return json;
}

}  // namespace

std::string ChartData::add(Chart chart) {
  const std::string title =
      chart.unit.empty() ? chart.title : fmt::format("{} in {}", chart.title, chart.unit);
  const std::string element = fmt::format(
      "<figure><figcaption><strong>{0}</strong> {1}</figcaption>\n"
      "<div class=\"chart\" data-chart=\"{2}\" role=\"img\" aria-label=\"Chart of {0} over time. "
      "{1}\"></div><div class=\"readout\" aria-hidden=\"true\"></div></figure>\n",
      html(title), html(chart.summary), charts_.size());
  charts_.push_back(std::move(chart));
  return element;
}

// All series of the finest grid are widened together: they keep one grid, and none pays for others.
void ChartData::shrink() {
  for (;;) {
    std::size_t bytes = 0;
    std::optional<int> finest;
    for (const Chart& chart : charts_) {
      for (const ChartSeries& series : chart.series) {
        if (chart.has_bands || series.values.is_constant() || corners_of(series)) continue;
        bytes += bytes_of(series.values);
        finest = std::min(finest.value_or(series.values.shift()), series.values.shift());
      }
    }
    constexpr int kWidest = 40;
    if (bytes <= most_bytes_ || !finest || *finest >= kWidest) return;
    for (Chart& chart : charts_) {
      for (ChartSeries& series : chart.series) series.values.widen_to(*finest + 1);
    }
  }
}

std::string ChartData::json(std::array<double, 2> window,
                            const std::vector<std::array<double, 2>>& faults) {
  shrink();
  Json json{{"window", window}, {"faults", faults}, {"charts", Json::array()}};
  for (const Chart& chart : charts_) {
    Json entry{{"title", chart.title},
               {"has_bands", chart.has_bands},
               {"fired", chart.fired},
               {"series", Json::array()}};
    if (chart.faults) entry["faults"] = *chart.faults;
    for (const ChartSeries& series : chart.series) {
      entry["series"].push_back(series_json(series, chart.has_bands));
    }
    json["charts"].push_back(std::move(entry));
  }
  return json_in_script(json.dump(-1, ' ', true, Json::error_handler_t::replace));
}

std::string base64_floats(const std::vector<float>& values) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((values.size() * 4 + 2) / 3 * 4);
  std::uint32_t bits = 0;  // those not yet written
  int count = 0;
  for (const float value : values) {
    const auto word = std::bit_cast<std::uint32_t>(value);
    for (int byte = 0; byte < 4; ++byte) {
      bits = (bits << 8U) | ((word >> (8 * byte)) & 0xFFU);
      for (count += 8; count >= 6; count -= 6) text += kDigits[(bits >> (count - 6)) & 63U];
    }
  }
  if (count > 0) text += kDigits[(bits << (6 - count)) & 63U];
  while (text.size() % 4 != 0) text += '=';
  return text;
}

std::vector<std::array<double, 2>> stretches_s(const std::vector<CycleRange>& ranges,
                                               double sample_time_s, double least_gap_s) {
  std::vector<std::array<double, 2>> stretches;
  for (const CycleRange& range : ranges) {
    const double from_s = static_cast<double>(range.from) * sample_time_s;
    const double until_s = static_cast<double>(range.until) * sample_time_s;
    if (!stretches.empty() && from_s - stretches.back()[1] < least_gap_s) {
      stretches.back()[1] = std::max(stretches.back()[1], until_s);
    } else {
      stretches.push_back({from_s, until_s});
    }
  }
  return stretches;
}

}  // namespace faultline

#include "tools/bench/latency_table.h"

#include <algorithm>
#include <array>

#include <faultline/latency_histogram_t.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace faultline {
namespace {

struct Percentile {
  double percent;
  const char* name;
};
constexpr std::array<Percentile, 4> kPercentiles{
    {{50.0, "p50"}, {90.0, "p90"}, {99.0, "p99"}, {99.9, "p99.9"}}};

double in_us(std::chrono::nanoseconds value) { return static_cast<double>(value.count()) * 1e-3; }

}  // namespace

std::string latency_table(const std::vector<StageLatency>& stages) {
  std::string text;
  for (const StageLatency& stage : stages) {
    const LatencyHistogram& histogram = stage.histogram;
    if (histogram.count() == 0) continue;
    if (text.empty()) {
      text = fmt::format("  {:<20}{:>10}", "latency, us", "values");
      for (const Percentile& percentile : kPercentiles) {
        text += fmt::format("{:>10}", percentile.name);
      }
      text += fmt::format("{:>11}\n", "max");
    }
    text += fmt::format("  {:<20}{:>10}", stage.stage, histogram.count());
    for (const Percentile& percentile : kPercentiles) {
      text += fmt::format("{:>10.1f}", in_us(histogram.percentile(percentile.percent)));
    }
    text += fmt::format("{:>11.1f}", in_us(histogram.max()));
    if (stage.cycles_per_value > 1) text += fmt::format("  1 cycle in {}", stage.cycles_per_value);
    if (histogram.corrected() > 0) text += fmt::format("  {} filled in", histogram.corrected());
    text += '\n';
  }
  return text;
}

nlohmann::ordered_json latency_json(const std::vector<StageLatency>& stages) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const StageLatency& stage : stages) {
    const LatencyHistogram& histogram = stage.histogram;
    nlohmann::ordered_json entry{{"stage", stage.stage},
                                 {"values", histogram.count()},
                                 {"filled_in", histogram.corrected()},
                                 {"cycles_per_value", stage.cycles_per_value},
                                 {"min_us", in_us(histogram.min())}};
    for (const Percentile& percentile : kPercentiles) {
      entry[fmt::format("{}_us", percentile.name)] =
          in_us(histogram.percentile(percentile.percent));
    }
    entry["max_us"] = in_us(histogram.max());
    json.push_back(std::move(entry));
  }
  return json;
}

StageLatency to_stage_latency(const latency_histogram_t& message) {
  std::vector<LatencyHistogram::Bucket> buckets;
  const std::size_t count = std::min(message.upper_ns.size(), message.counts.size());
  for (std::size_t i = 0; i < count; ++i) {
    buckets.push_back({std::chrono::nanoseconds(message.upper_ns[i]),
                       static_cast<std::uint64_t>(std::max<std::int64_t>(message.counts[i], 0))});
  }
  return {.stage = message.stage,
          .histogram = LatencyHistogram::restore(
              buckets, std::chrono::nanoseconds(message.min_ns),
              std::chrono::nanoseconds(message.max_ns),
              static_cast<std::uint64_t>(std::max<std::int64_t>(message.corrected, 0))),
          .cycles_per_value =
              static_cast<std::uint32_t>(std::max<std::int32_t>(message.cycles_per_value, 1))};
}

}  // namespace faultline

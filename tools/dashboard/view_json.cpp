#include "tools/dashboard/view_json.h"

#include <algorithm>
#include <chrono>
#include <cstdint>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/bench/run_history.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

double as_ms(std::chrono::nanoseconds time) {
  return std::chrono::duration<double, std::milli>(time).count();
}

/// Upper edge of the bucket below which a share of the latencies lies, or the largest of them if
/// that is less; µs.
double percentile_us(const latency_histogram_t& latency, double share) {
  std::int64_t below = 0;
  const double wanted = share * static_cast<double>(latency.count);
  for (std::size_t i = 0; i < latency.counts.size(); ++i) {
    below += latency.counts[i];
    if (static_cast<double>(below) >= wanted) {
      return static_cast<double>(std::min(latency.upper_ns[i], latency.max_ns)) * 1e-3;
    }
  }
  return static_cast<double>(latency.max_ns) * 1e-3;
}

Json latencies(const LiveView& view) {
  Json result = Json::array();
  if (!view.stats()) return result;
  for (const latency_histogram_t& latency : view.stats()->latency) {
    result.push_back({{"stage", latency.stage},
                      {"p50_us", percentile_us(latency, 0.5)},
                      {"p99_us", percentile_us(latency, 0.99)},
                      {"p999_us", percentile_us(latency, 0.999)},
                      {"max_us", static_cast<double>(latency.max_ns) * 1e-3}});
  }
  return result;
}

std::string message_name(const LiveView& view, const IdentifierTraffic& traffic) {
  return traffic.message < view.dbc().messages.size()
             ? view.dbc().messages[traffic.message].name
             : fmt::format("{:0{}X}", traffic.id, traffic.is_extended ? 8 : 3);
}

Json traffic_rows(const LiveView& view) {
  Json result = Json::array();
  for (const IdentifierTraffic& traffic : view.traffic().identifiers()) {
    const IntegrityCounters& counters = traffic.integrity.counters();
    result.push_back({{"name", message_name(view, traffic)},
                      {"bus", traffic.bus},
                      {"frames", traffic.frames},
                      {"period_ms", traffic.period.mean_s() * 1e3},
                      {"due_ms", as_ms(traffic.period.period())},
                      {"jitter_ms", traffic.period.deviation_s() * 1e3},
                      {"lost", counters.lost},
                      {"bad", counters.bad_frames()},
                      {"state", static_cast<int>(state(traffic, view.last_frame()))}});
  }
  return result;
}

Json counters(const stats_t& stats) {
  return {{"frames", stats.frames_received},   {"dropped", stats.frames_dropped},
          {"unlogged", stats.frames_unlogged}, {"bad_samples", stats.bad_samples},
          {"overruns", stats.overruns},        {"late_cycles", stats.late_cycles}};
}

/// Texts from outside need not be UTF-8, JSON must.
std::string dump(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

std::string run_json(const LiveView& view) {
  Json result = {{"type", "run"}, {"run_id", view.run_id()}, {"revision", view.run_revision()}};
  if (view.bank()) {
    const Bank& bank = *view.bank();
    result["name"] = bank.name;
    result["plant"] = bank.plant_name;
    result["sample_time_s"] = bank.sample_time_s;
    result["faults"] = bank.fault_names;
    result["inputs"] = bank.input_names;
    result["outputs"] = bank.output_names;
    Json& sizes = result["sizes"] = Json::object();
    for (std::size_t fault = 0; fault < bank.fault_names.size(); ++fault) {
      const double smallest = smallest_isolated(bank, fault);
      if (smallest > 0.0) sizes[bank.fault_names[fault]] = 2.0 * smallest;
    }
    Json& names = result["residuals"] = Json::array();
    for (const ResidualFilter& filter : bank.filters) names.push_back(filter.name);
  }
  return dump(result);
}

std::string state_json(const LiveView& view, LiveView::Clock::time_point now) {
  Json result = {{"type", "state"},
                 {"revision", view.run_revision()},
                 {"running", view.is_running(now)},
                 {"verdict", view.verdict_text()}};
  if (view.diagnosis()) {
    result["kind"] = view.diagnosis()->verdict;
    result["cause"] = view.diagnosis()->cause;
    result["since_cycle"] = view.diagnosis()->since_cycle;
  }
  if (const auto age_s = view.verdict_age_s()) result["since_s"] = *age_s;
  if (view.residual()) {
    const residual_t& residual = *view.residual();
    result["cycle"] = residual.cycle;
    result["evaluation"] = residual.evaluation;
    result["threshold"] = residual.threshold;
    Json& fired = result["fired"] = Json::array();
    for (const auto one : residual.fired) fired.push_back(one != 0 ? 1 : 0);
    result["least"] = view.least();
    result["greatest"] = view.greatest();
  }
  if (view.truth()) {
    Json& faults = result["injected"] = Json::array();
    for (const injected_fault_t& fault : view.truth()->faults) {
      faults.push_back({{"target", fault.target}, {"kind", fault.kind}, {"value", fault.value}});
    }
  }
  if (view.stats()) result["counters"] = counters(*view.stats());
  result["lost"] = view.lost();
  result["unreadable"] = view.unreadable();
  result["latency"] = latencies(view);
  result["traffic"] = traffic_rows(view);
  Json& events = result["events"] = Json::array();
  for (const event_t& event : view.events()) {
    events.push_back({{"sequence", event.sequence},
                      {"cycle", event.cycle},
                      {"severity", event.severity},
                      {"source", event.source},
                      {"text", event.text}});
  }
  return dump(result);
}

}  // namespace faultline

#include "tools/bench/run_summary.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "drivers/can/input_backlog.h"
#include "tools/bench/latency_table.h"
#include "tools/bench/verdict_report.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

Json count_or_null(const std::optional<std::uint64_t>& count) {
  return count ? Json(*count) : Json(nullptr);
}

/// Latency of the diagnosis, from the kernel's stamp to the queued record, over the bare reader's.
struct ProbeRatio {
  double p50 = 0.0, p99 = 0.0;
};

const LatencyHistogram* histogram_of(const std::vector<StageLatency>& stages,
                                     std::string_view name) {
  for (const StageLatency& stage : stages) {
    if (stage.stage == name && stage.histogram.count() > 0) return &stage.histogram;
  }
  return nullptr;
}

std::optional<ProbeRatio> probe_ratio(const std::vector<StageLatency>& stages) {
  const LatencyHistogram* const total = histogram_of(stages, "total");
  const LatencyHistogram* const probe = histogram_of(stages, "probe: stamp->read");
  if (total == nullptr || probe == nullptr) return std::nullopt;
  const auto ratio_at = [&](double percent) {
    const auto bare_ns = std::max<std::int64_t>(probe->percentile(percent).count(), 1);
    return static_cast<double>(total->percentile(percent).count()) / static_cast<double>(bare_ns);
  };
  return ProbeRatio{ratio_at(50.0), ratio_at(99.0)};
}

void print_realtime(std::FILE* out, const BenchResult& result) {
  const RunCounters& counters = result.counters;
  if (counters.page_faults) {
    fmt::print(out, "  diagnosis thread after warm-up: {}{} page faults\n",
               counters.allocations ? fmt::format("{} allocations, ", *counters.allocations) : "",
               *counters.page_faults);
  }
  const std::string table = latency_table(result.latencies);
  if (!table.empty()) fmt::print(out, "\n{}", table);
  if (const auto ratio = probe_ratio(result.latencies)) {
    fmt::print(out, "  total : probe     p50 {:.2f}, p99 {:.2f}\n", ratio->p50, ratio->p99);
  }
  if (!table.empty()) fmt::print(out, "\n");
}

std::string delay_text(const std::optional<double>& delay_s) {
  return delay_s ? fmt::format("{:.0f} ms", *delay_s * 1e3) : "-";
}

std::string injected_text(const InjectionOutcome& outcome) {
  return outcome.faults.empty() ? "none" : fmt::format("{}", fmt::join(outcome.faults, ", "));
}

void print_injections(std::FILE* out, const RunHistory& history) {
  constexpr int kDetailColumn = 41;  // under "diagnosed"
  fmt::print(out, "\n  {:>19}   {:<16} {:<28} {:>9} {:>9}\n", "time, s", "injected", "diagnosed",
             "detected", "isolated");
  for (const InjectionOutcome& outcome : history.injections()) {
    fmt::print(out, "  {:>8.2f} .. {:>7.2f}   {:<16} {:<28} {:>9} {:>9}\n", outcome.from_s,
               outcome.until_s, injected_text(outcome),
               verdict_text(history.verdicts()[outcome.last_verdict]),
               outcome.faults.empty() ? "" : delay_text(outcome.detection_delay_s),
               outcome.faults.empty() ? "" : delay_text(outcome.isolation_delay_s));
    const std::string detail = verdict_detail(history.verdicts()[outcome.last_verdict]);
    if (!detail.empty()) fmt::print(out, "{:{}}{}\n", "", kDetailColumn, detail);
    for (const SmallFault& fault : outcome.small_faults) {
      fmt::print(out, "{:{}}{} {:.3g} is below {:.3g}, the smallest that is isolated\n", "",
                 kDetailColumn, fault.fault, fault.value, fault.smallest);
    }
  }
}

void print_residuals(std::FILE* out, const Bank& bank, const RunHistory& history) {
  fmt::print(out, "\n  residual  ignores      first fired\n");
  for (std::size_t i = 0; i < bank.filters.size(); ++i) {
    std::vector<std::string> ignored;
    for (const std::size_t fault : bank.filters[i].ignores) {
      ignored.push_back(bank.fault_names[fault]);
    }
    const auto& first_s = history.first_fired_s()[i];
    fmt::print(out, "  {:<9} {:<12} {}\n", bank.filters[i].name,
               fmt::format("{}", fmt::join(ignored, ", ")),
               first_s ? fmt::format("{:.3f} s", *first_s) : "never");
  }
}

std::string integrity_text(const MessageCounters& counters) {
  const IntegrityCounters& found = counters.integrity;
  std::vector<std::string> parts;
  const auto add = [&](std::uint64_t count, std::string_view what) {
    if (count > 0) parts.push_back(fmt::format("{} {}", count, what));
  };
  add(found.wrong_crc, "wrong CRC");
  add(found.repeated, "repeated");
  add(found.out_of_range, "counter out of range");
  add(found.too_short, "too short");
  add(found.gaps, found.gaps == 1 ? "gap" : "gaps");
  add(found.lost, "lost");
  return fmt::format("{} (of {} frames)", fmt::join(parts, ", "), found.frames);
}

std::string log_text(const BenchOptions& options) {
  if (!options.log) return "none";
  return (options.log_split.is_wanted() ? split_log_pattern(*options.log) : *options.log).string();
}

}  // namespace

void print_integrity(std::FILE* out, const SignalMap& map,
                     const std::vector<MessageCounters>& messages) {
  for (std::size_t i = 0; i < messages.size(); ++i) {
    if (messages[i].is_integrity_clean()) continue;
    fmt::print(out, "  WARNING  {}: {}\n", map.message_name(i), integrity_text(messages[i]));
  }
}

nlohmann::ordered_json message_json(const std::string& name, const MessageCounters& counters) {
  const IntegrityCounters& found = counters.integrity;
  return {{"message", name},
          {"frames", found.frames},
          {"missing", counters.missing},
          {"late", counters.late},
          {"came_twice", counters.repeated},
          {"too_short", counters.too_short},
          {"not_finite", counters.not_finite},
          {"wrong_crc", found.wrong_crc},
          {"counter_repeated", found.repeated},
          {"counter_out_of_range", found.out_of_range},
          {"counter_gaps", found.gaps},
          {"counter_lost", found.lost}};
}

void print_dbc_warnings(std::FILE* out, const std::vector<std::string>& warnings) {
  constexpr std::size_t kShown = 3;
  for (std::size_t i = 0; i < std::min(warnings.size(), kShown); ++i) {
    fmt::print(out, "  WARNING  {}\n", warnings[i]);
  }
  if (warnings.size() > kShown) {
    fmt::print(out, "  WARNING  and {} more about the DBC (faultline can dbc check)\n",
               warnings.size() - kShown);
  }
}

void print_summary(std::FILE* out, const BenchInputs& inputs, const BenchOptions& options,
                   const BenchResult& result) {
  const RunCounters& counters = result.counters;
  fmt::print(out, "{} on {}, {}: {} samples in {:.2f} s ({:.0f} per second)\n",
             inputs.scenario.name, options.bus, options.is_realtime ? "real time" : "lock-step",
             counters.samples, result.wall_s,
             static_cast<double>(counters.samples) / result.wall_s);
  print_injections(out, result.history);
  print_residuals(out, inputs.bank, result.history);
  fmt::print(out,
             "\n  frames   sent {}, received by the diagnosis {}, dropped {}, send errors {}\n"
             "  cycles   {}, late {}, overruns {}, skipped {}\n"
             "  samples  {}, bad {}\n",
             counters.frames_sent, counters.frames_received, counters.frames_dropped,
             counters.send_errors, counters.cycles, counters.late_cycles, counters.overruns,
             counters.skipped_cycles, counters.samples, counters.bad_samples);
  if (!counters.frame_faults.is_clean()) {
    fmt::print(out, "  faults   frames dropped {}, changed {}, late {}, added {}\n",
               counters.frame_faults.dropped, counters.frame_faults.changed,
               counters.frame_faults.late, counters.frame_faults.added);
  }
  print_realtime(out, result);
  print_integrity(out, inputs.map, result.messages);
  print_dbc_warnings(out, inputs.dbc_warnings);
  for (const std::string& warning : inputs.warnings) {
    fmt::print(out, "  WARNING  {}\n", warning);
  }
  for (const std::string& warning : inputs.perturbations.warnings()) {
    fmt::print(out, "  WARNING  {}\n", warning);
  }
  if (counters.clamped_values > 0) {
    fmt::print(out, "  WARNING  {} values did not fit their signals and were sent clamped\n",
               counters.clamped_values);
  }
  if (counters.backlog_drops > 0) {
    fmt::print(out, "  WARNING  {}\n", backlog_drops_text(counters.backlog_drops));
  }
  if (counters.records_dropped > 0) {
    fmt::print(out, "  WARNING  {} samples are missing in log and summary: the queue was full\n",
               counters.records_dropped);
  }
  if (counters.frames_unlogged > 0) {
    fmt::print(out, "  WARNING  {} received frames are missing in the log: its queue was full\n",
               counters.frames_unlogged);
  }
  fmt::print(out, "  log      {}\n", log_text(options));
  const auto expectations = result.history.expectations();
  if (!expectations.empty()) fmt::print(out, "\n  expectations\n");
  for (const ExpectationOutcome& outcome : expectations) {
    fmt::print(out, "  {}\n", expectation_text(outcome));
  }
  if (result.stop_reason) fmt::print(out, "\n  STOPPED: {}\n", result.stop_reason->text);
  if (result.is_interrupted) fmt::print(out, "\n  STOPPED by signal {}\n", result.signal);
}

nlohmann::ordered_json summary_json(const BenchInputs& inputs, const BenchOptions& options,
                                    const BenchResult& result) {
  const RunCounters& counters = result.counters;
  const RunHistory& history = result.history;
  Json json{{"scenario", inputs.scenario.name},    {"bus", options.bus},
            {"realtime", options.is_realtime},     {"samples", counters.samples},
            {"bad_samples", counters.bad_samples}, {"wall_s", result.wall_s}};
  json["verdicts"] = Json::array();
  for (const VerdictEntry& entry : history.verdicts()) {
    json["verdicts"].push_back(verdict_json(entry));
  }
  json["injections"] = Json::array();
  for (const InjectionOutcome& outcome : history.injections()) {
    Json below = Json::array();
    for (const SmallFault& fault : outcome.small_faults) {
      below.push_back(
          {{"fault", fault.fault}, {"value", fault.value}, {"smallest", fault.smallest}});
    }
    json["injections"].push_back({{"from_s", outcome.from_s},
                                  {"until_s", outcome.until_s},
                                  {"faults", outcome.faults},
                                  {"detection_delay_s", seconds_or_null(outcome.detection_delay_s)},
                                  {"isolation_delay_s", seconds_or_null(outcome.isolation_delay_s)},
                                  {"below_smallest_isolated", below}});
  }
  json["residuals"] = Json::object();
  for (std::size_t i = 0; i < inputs.bank.filters.size(); ++i) {
    json["residuals"][inputs.bank.filters[i].name] = {
        {"first_fired_s", seconds_or_null(history.first_fired_s()[i])}};
  }
  json["frames"] = {
      {"sent", counters.frames_sent},         {"received", counters.frames_received},
      {"dropped", counters.frames_dropped},   {"backlog_drops", counters.backlog_drops},
      {"unlogged", counters.frames_unlogged}, {"send_errors", counters.send_errors}};
  json["frame_faults"] = {{"dropped", counters.frame_faults.dropped},
                          {"changed", counters.frame_faults.changed},
                          {"late", counters.frame_faults.late},
                          {"added", counters.frame_faults.added}};
  json["cycles"] = {{"total", counters.cycles},
                    {"late", counters.late_cycles},
                    {"overruns", counters.overruns},
                    {"skipped", counters.skipped_cycles}};
  json["diagnosis_thread"] = {{"allocations", count_or_null(counters.allocations)},
                              {"page_faults", count_or_null(counters.page_faults)}};
  json["latency"] = latency_json(result.latencies);
  if (const auto ratio = probe_ratio(result.latencies)) {
    json["probe_ratio"] = {{"p50", ratio->p50}, {"p99", ratio->p99}};
  }
  json["messages"] = Json::array();
  for (std::size_t i = 0; i < result.messages.size(); ++i) {
    json["messages"].push_back(message_json(inputs.map.message_name(i), result.messages[i]));
  }
  json["clamped_values"] = counters.clamped_values;
  json["records_dropped"] = counters.records_dropped;
  json["log"] = options.log ? Json(log_text(options)) : Json(nullptr);
  json["expect"] = {{"met", history.are_expectations_met()}, {"items", Json::array()}};
  for (const ExpectationOutcome& outcome : history.expectations()) {
    json["expect"]["items"].push_back(expectation_json(outcome));
  }
  json["interrupted"] = result.is_interrupted;
  json["stopped"] = result.stop_reason ? Json(result.stop_reason->text) : Json(nullptr);
  return json;
}

}  // namespace faultline

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <unistd.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "drivers/dbc/dbc_parser.h"
#include "drivers/signal/traffic_monitor.h"
#include "tools/can/bus_load.h"
#include "tools/can/bus_session.h"
#include "tools/can/can_command.h"
#include "tools/can/frame_filter.h"
#include "tools/can/frame_log.h"
#include "tools/can/problem_report.h"
#include "tools/cli.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

struct StatsArguments {
  std::vector<std::string> sources, filters;
  std::string dbc, json;
  SessionLimits limits;
  BitRates rates;
  bool shows_jitter = false;
};

/// What was seen, whatever it came from.
struct Traffic {
  TrafficMonitor monitor;
  BusLoad load;
  std::vector<std::string> bus_names;
  double duration_s = 0.0;
  std::optional<BusCounters> counters;  ///< of the endpoint; a log has none
  std::uint64_t backlog_drops = 0;      ///< packets lost before the endpoint
  std::uint64_t missing = 0;            ///< of which the log says so
};

double rate_Hz(std::uint64_t count, double duration_s) {
  return duration_s > 0.0 ? static_cast<double>(count) / duration_s : 0.0;
}

double percent(double part, double whole) { return whole > 0.0 ? 100.0 * part / whole : 0.0; }

std::string bus_name(const Traffic& traffic, std::size_t bus) {
  return bus < traffic.bus_names.size() ? traffic.bus_names[bus] : fmt::format("{}", bus);
}

std::string milliseconds(std::chrono::nanoseconds time) {
  return fmt::format("{:.3g}", std::chrono::duration<double, std::milli>(time).count());
}

std::string message_name(const DbcDatabase& dbc, const IdentifierTraffic& traffic) {
  return traffic.message == IdentifierTraffic::kNoMessage ? std::string()
                                                          : dbc.messages[traffic.message].name;
}

/// The busiest first; messages of the DBC that never came last.
std::vector<const IdentifierTraffic*> by_frames(const TrafficMonitor& monitor) {
  std::vector<const IdentifierTraffic*> sorted;
  for (const IdentifierTraffic& traffic : monitor.identifiers()) sorted.push_back(&traffic);
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const auto* a, const auto* b) { return a->frames > b->frames; });
  return sorted;
}

std::string integrity_text(const IntegrityCounters& counters) {
  std::vector<std::string> parts;
  const auto add = [&](std::uint64_t count, const char* what) {
    if (count > 0) parts.push_back(fmt::format("{} {}", count, what));
  };
  add(counters.wrong_crc, "wrong CRC");
  add(counters.repeated, "repeated");
  add(counters.out_of_range, "counter out of range");
  add(counters.too_short, "too short");
  add(counters.lost, "lost by counter");
  return fmt::format("{}", fmt::join(parts, ", "));
}

/// "-50 %: 3 | -20 %: 0 ..." is hard to read: a bar of one digit per bin says where the mass is.
void print_jitter(std::FILE* out, const PeriodStatistics& period) {
  if (!period.has_period() || period.intervals() == 0) return;
  fmt::print(out, "{:>10}jitter, % of the period:", "");
  const auto& edges = PeriodStatistics::kJitterEdges;
  const auto& bins = period.jitter();
  for (std::size_t i = 0; i < bins.size(); ++i) {
    if (bins[i] == 0) continue;
    if (i == 0) {
      fmt::print(out, "  below {:g}: {}", 100.0 * edges.front(), bins[i]);
    } else if (i == edges.size()) {
      fmt::print(out, "  from {:g}: {}", 100.0 * edges.back(), bins[i]);
    } else {
      fmt::print(out, "  {:g}..{:g}: {}", 100.0 * edges[i - 1], 100.0 * edges[i], bins[i]);
    }
  }
  fmt::print(out, "\n");
}

void print_stats(std::FILE* out, const Traffic& traffic, const DbcDatabase& dbc,
                 const StatsArguments& arguments) {
  fmt::print(out,
             "{:<7} {:>8}  {:<20} {:>9} {:>9}  {:>7} {:>7} {:>7} {:>7}  {:>5} {:>5} {:>5}  {}\n",
             "bus", "id", "message", "frames", "1/s", "T ms", "mean", "least", "most", "early",
             "late", "lost", "integrity");
  for (const IdentifierTraffic* const seen : by_frames(traffic.monitor)) {
    const PeriodStatistics& period = seen->period;
    const bool has_times = period.intervals() > 0;
    fmt::print(
        out, "{:<7} {:>8}  {:<20} {:>9} {:>9.1f}  {:>7} {:>7} {:>7} {:>7}  {:>5} {:>5} {:>5}  {}\n",
        bus_name(traffic, seen->bus), fmt::format("{:0{}X}", seen->id, seen->is_extended ? 8 : 3),
        message_name(dbc, *seen), seen->frames, rate_Hz(seen->frames, traffic.duration_s),
        period.has_period() ? milliseconds(period.period()) : "-",
        has_times ? fmt::format("{:.3g}", 1e3 * period.mean_s()) : "-",
        has_times ? milliseconds(period.least()) : "-",
        has_times ? milliseconds(period.greatest()) : "-",
        period.has_period() ? fmt::format("{}", period.early()) : "-",
        period.has_period() ? fmt::format("{}", period.late()) : "-",
        period.has_period() ? fmt::format("{}", period.lost()) : "-",
        seen->frames == 0 ? "never seen" : integrity_text(seen->integrity.counters()));
    if (arguments.shows_jitter) print_jitter(out, period);
  }
  const std::vector<BusLoad::Load>& loads = traffic.load.loads();
  for (std::size_t bus = 0; bus < loads.size(); ++bus) {
    fmt::print(out, "{}: {} frames in {:.3f} s, {:.1f} per second; load {:.2f} % of {:g} kbit/s",
               bus_name(traffic, bus), loads[bus].frames, traffic.duration_s,
               rate_Hz(loads[bus].frames, traffic.duration_s),
               percent(loads[bus].busy_s, traffic.duration_s), 1e-3 * arguments.rates.nominal);
    fmt::print(out, ", busiest second {:.2f} %\n", percent(loads[bus].peak_second_s, 1.0));
  }
  if (traffic.monitor.error_frames() > 0) {
    fmt::print(out, "{} error frames\n", traffic.monitor.error_frames());
  }
  if (traffic.counters) fmt::print(out, "{}\n", counters_text(*traffic.counters));
  if (traffic.missing > 0) fmt::print(out, "{} frames missing from the log\n", traffic.missing);
}

Json identifier_json(const Traffic& traffic, const DbcDatabase& dbc,
                     const IdentifierTraffic& seen) {
  const PeriodStatistics& period = seen.period;
  Json json{{"bus", bus_name(traffic, seen.bus)}, {"id", seen.id}, {"extended", seen.is_extended}};
  const std::string name = message_name(dbc, seen);
  json["message"] = name.empty() ? Json(nullptr) : Json(name);
  json["frames"] = seen.frames;
  json["remote_frames"] = seen.remote_frames;
  json["rate_Hz"] = rate_Hz(seen.frames, traffic.duration_s);
  if (period.intervals() > 0) {
    json["period"] = {{"mean_s", period.mean_s()},
                      {"deviation_s", period.deviation_s()},
                      {"min_s", std::chrono::duration<double>(period.least()).count()},
                      {"max_s", std::chrono::duration<double>(period.greatest()).count()},
                      {"backward_stamps", period.backward()}};
  }
  if (period.has_period()) {
    Json& json_period = json["period"];
    json_period["nominal_s"] = std::chrono::duration<double>(period.period()).count();
    json_period["early"] = period.early();
    json_period["late"] = period.late();
    json_period["lost"] = period.lost();
    json_period["jitter_edges"] = PeriodStatistics::kJitterEdges;
    json_period["jitter_counts"] = period.jitter();
  }
  const IntegrityCounters& counters = seen.integrity.counters();
  if (counters.frames > 0) {
    json["integrity"] = {{"checked", counters.frames},      {"wrong_crc", counters.wrong_crc},
                         {"repeated", counters.repeated},   {"out_of_range", counters.out_of_range},
                         {"too_short", counters.too_short}, {"gaps", counters.gaps},
                         {"lost", counters.lost},           {"restarts", counters.restarts}};
  }
  return json;
}

Json stats_json(const Traffic& traffic, const DbcDatabase& dbc, const StatsArguments& arguments) {
  Json json{{"duration_s", traffic.duration_s},
            {"frames", traffic.monitor.frames()},
            {"error_frames", traffic.monitor.error_frames()},
            {"untracked_frames", traffic.monitor.untracked_frames()},
            {"missing_frames", traffic.missing},
            {"bitrate_bit_per_s", arguments.rates.nominal},
            {"data_bitrate_bit_per_s", arguments.rates.data},
            {"buses", Json::array()},
            {"identifiers", Json::array()}};
  if (traffic.counters) {
    json["received"] = traffic.counters->received;
    json["dropped"] = traffic.counters->dropped;
    json["backlog_drops"] = traffic.backlog_drops;
    json["malformed"] = traffic.counters->malformed;
    json["bus_offs"] = traffic.counters->bus_offs;
    json["restarts"] = traffic.counters->restarts;
    json["outages"] = traffic.counters->outages;
  }
  const std::vector<BusLoad::Load>& loads = traffic.load.loads();
  for (std::size_t bus = 0; bus < loads.size(); ++bus) {
    json["buses"].push_back({{"bus", bus_name(traffic, bus)},
                             {"frames", loads[bus].frames},
                             {"busy_s", loads[bus].busy_s},
                             {"load", percent(loads[bus].busy_s, traffic.duration_s) / 100.0},
                             {"peak_second_load", loads[bus].peak_second_s}});
  }
  for (const IdentifierTraffic* const seen : by_frames(traffic.monitor)) {
    json["identifiers"].push_back(identifier_json(traffic, dbc, *seen));
  }
  return json;
}

/// Index of the bus with this name, a new one if need be.
std::uint8_t bus_index(std::vector<std::string>& names, std::string_view name) {
  const auto found = std::find(names.begin(), names.end(), name);
  const auto index = static_cast<std::size_t>(found - names.begin());
  if (found == names.end()) names.emplace_back(name);
  return static_cast<std::uint8_t>(
      std::min<std::size_t>(index, std::numeric_limits<std::uint8_t>::max()));
}

int read_logs(const StatsArguments& arguments, const DbcDatabase* dbc, const FrameFilter& filter,
              Traffic& traffic) {
  ProblemReport problems;
  FrameLogReceiver receiver;
  receiver.on_frame = [&](const CanFrame& frame, std::string_view bus) {
    if (!filter.passes(frame)) return;
    CanFrame tagged = frame;
    tagged.bus = bus_index(traffic.bus_names, bus);
    traffic.monitor.on_frame(tagged);
    traffic.load.add(tagged);
  };
  receiver.on_problem = [&](const std::string& text) { problems.add(text); };
  receiver.on_remark = ProblemReport::remark;
  for (const std::string& log : arguments.sources) {
    traffic.missing += read_frame_log(log, dbc, receiver).missing;
  }
  traffic.duration_s = traffic.load.span_s();
  return problems.exit_code();
}

void listen(const StatsArguments& arguments, const FrameFilter& filter, Traffic& traffic) {
  BusSession session(arguments.sources);
  for (std::size_t bus = 0; bus < session.names().size(); ++bus) {
    CanFrame frame;
    frame.bus = static_cast<std::uint8_t>(bus);
    traffic.bus_names.emplace_back(session.name_of(frame));
  }
  const bool is_terminal = ::isatty(STDERR_FILENO) == 1;
  const auto on_frame = [&](const CanFrame& frame) {
    if (!filter.passes(frame)) return;
    traffic.monitor.on_frame(frame);
    traffic.load.add(frame);
  };
  const auto on_pause = [&] {
    if (!is_terminal) return;
    fmt::print(stderr, "\r\x1b[K  {} frames, {} dropped (Ctrl-C ends)", traffic.monitor.frames(),
               session.counters().dropped);
  };
  traffic.duration_s = session.listen(arguments.limits, on_frame, on_pause).count();
  if (is_terminal) fmt::print(stderr, "\r\x1b[K");
  traffic.counters = session.counters();
  traffic.backlog_drops = session.backlog_drops();
}

int stats(const StatsArguments& arguments) {
  DbcDatabase dbc;
  const bool has_dbc = !arguments.dbc.empty();
  if (has_dbc) {
    dbc = read_dbc(arguments.dbc);
    report_dbc_errors(dbc);
  }
  const FrameFilter filter(arguments.filters, has_dbc ? &dbc : nullptr);
  Traffic traffic{TrafficMonitor(dbc), BusLoad(arguments.rates), {}, 0.0, std::nullopt, 0};
  const auto is_log = [](const std::string& source) {
    return source == "-" || std::filesystem::exists(source);
  };
  int exit_code = kExitYes;
  if (std::all_of(arguments.sources.begin(), arguments.sources.end(), is_log)) {
    exit_code = read_logs(arguments, has_dbc ? &dbc : nullptr, filter, traffic);
  } else {
    listen(arguments, filter, traffic);
  }
  print_stats(human_output(arguments.json), traffic, dbc, arguments);
  if (!arguments.json.empty()) write_json(stats_json(traffic, dbc, arguments), arguments.json);
  return exit_code;
}

}  // namespace

void add_stats_command(CLI::App& parent, int& exit_code) {
  CLI::App* command = parent.add_subcommand(
      "stats", "Rates, bus load, periods, losses and integrity of buses or logs");
  auto arguments = std::make_shared<StatsArguments>();
  command
      ->add_option("SOURCE", arguments->sources,
                   "can:IFACE, udp:GROUP:PORT; or candump logs, LCM logs (-: candump on stdin)")
      ->required()
      ->type_name("BUS|LOG");
  add_limit_options(*command, arguments->limits);
  command->add_option("--dbc", arguments->dbc, "DBC file: names, periods, counters, checksums")
      ->check(CLI::ExistingFile);
  add_filter_option(*command, arguments->filters);
  command->add_option("--bitrate", arguments->rates.nominal, "bit/s, for the load")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--data-bitrate", arguments->rates.data, "bit/s of CAN FD data with BRS")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_flag("--jitter", arguments->shows_jitter,
                    "Show how far the times between frames are from the DBC's period");
  add_json_option(*command, arguments->json);
  command->footer(
      "T: the period that the DBC gives (GenMsgCycleTime). early: came after less than half of it; "
      "late: after more than 1.5 of it; lost: frames that should have come in between. The load "
      "counts each frame's bits on the wire with its stuff bits. Ends at Ctrl-C, with exit code "
      "0.\n" +
      std::string(kExitCodesHelp));
  command->callback([arguments, &exit_code] { exit_code = stats(*arguments); });
}

}  // namespace faultline

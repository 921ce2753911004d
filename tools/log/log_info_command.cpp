#include <algorithm>
#include <array>
#include <cstdio>
#include <ctime>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <CLI/App.hpp>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "tools/bench/latency_table.h"
#include "tools/cli.h"
#include "tools/log/log_command.h"
#include "tools/log/log_info.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

/// "2026-11-22 14:01:12.345 UTC"; nothing for what is no time of this era.
std::string date_text(std::int64_t utime) {
  constexpr std::int64_t kPerSecond = 1'000'000;
  constexpr std::int64_t kYear2200 = 7'258'118'400;
  if (utime < 0 || utime / kPerSecond > kYear2200) return {};
  return fmt::format("{:%Y-%m-%d %H:%M:%S}.{:03} UTC",
                     fmt::gmtime(static_cast<std::time_t>(utime / kPerSecond)),
                     utime % kPerSecond / 1000);
}

Json print_verdict(std::FILE* out, const LogInfo::VerdictChange& change) {
  std::vector<std::string> sets;
  for (const auto& set : change.sets) sets.push_back(fmt::format("{}", fmt::join(set, ", ")));
  Json estimates = Json::array();
  std::vector<std::string> details;
  if (change.cause != "none" && change.cause != "complete") details.push_back(change.cause);
  if (!change.blame.empty()) details.push_back(change.blame);
  for (const LogInfo::Estimate& estimate : change.estimates) {
    const bool has_deviation = estimate.deviation >= 0.0;
    details.push_back(
        fmt::format("{} = {:.6g}{}", estimate.fault, estimate.value,
                    has_deviation ? fmt::format(" +- {:.2g}", estimate.deviation) : std::string()));
    estimates.push_back({{"fault", estimate.fault},
                         {"value", estimate.value},
                         {"deviation", has_deviation ? Json(estimate.deviation) : Json(nullptr)}});
  }
  if (change.onset_cycle >= 0) {
    details.push_back(fmt::format("onset cycle {}", change.onset_cycle));
  }
  fmt::print(out, "  {:>10.3f} s  {} {}{}\n", change.t_s, change.verdict, fmt::join(sets, " | "),
             details.empty() ? "" : fmt::format("  ({})", fmt::join(details, ", ")));
  return {{"cycle", change.cycle}, {"t_s", change.t_s},     {"verdict", change.verdict},
          {"cause", change.cause}, {"blame", change.blame}, {"onset_cycle", change.onset_cycle},
          {"sets", change.sets},   {"estimates", estimates}};
}

Json print_latencies(std::FILE* out, const stats_t& stats) {
  std::vector<StageLatency> stages;
  // lcm-gen's decoder leaves an array alone whose count is zero.
  for (std::int32_t i = 0; i < stats.stage_count; ++i) {
    stages.push_back(to_stage_latency(stats.latency[static_cast<std::size_t>(i)]));
  }
  fmt::print(out, "{}", latency_table(stages));
  return latency_json(stages);
}

Json print_stats(std::FILE* out, const stats_t& stats) {
  const std::array<std::pair<const char*, std::int64_t>, 13> counters{{
      {"frames_sent", stats.frames_sent},
      {"send_errors", stats.send_errors},
      {"frames_received", stats.frames_received},
      {"frames_dropped", stats.frames_dropped},
      {"frames_unlogged", stats.frames_unlogged},
      {"samples", stats.samples},
      {"bad_samples", stats.bad_samples},
      {"late_cycles", stats.late_cycles},
      {"overruns", stats.overruns},
      {"skipped_cycles", stats.skipped_cycles},
      {"records_dropped", stats.records_dropped},
      {"resets", stats.resets},
      {"allocations", stats.allocations},
  }};
  fmt::print(out, "  {} frames sent, {} received; {} samples", stats.frames_sent,
             stats.frames_received, stats.samples);
  Json json{{"cycle", stats.cycle}, {"is_final", stats.is_final != 0}};
  constexpr std::string_view kTold = "frames_sent frames_received samples allocations";
  for (const auto& [name, value] : counters) {
    json[name] = value;
    if (value == 0 || kTold.find(name) != std::string_view::npos) continue;
    std::string words(name);
    std::replace(words.begin(), words.end(), '_', ' ');
    fmt::print(out, ", {} {}", value, words);
  }
  if (stats.allocations >= 0) {
    fmt::print(out, "; {} allocations in the diagnosis thread", stats.allocations);
  }
  fmt::print(out, "\n");
  json["latency"] = print_latencies(out, stats);
  return json;
}

template <class Value>
Json json_of(const std::optional<Value>& value) {
  return value ? Json(*value) : Json(nullptr);
}

Json print_info(std::FILE* out, const std::vector<std::string>& files, const LogInfo& info) {
  fmt::print(out, "{}: {} messages in {:.3f} s", fmt::join(files, ", "), info.messages,
             info.duration_s);
  const std::string date = date_text(info.first_utime);
  fmt::print(out, "{}\n", date.empty() ? "" : " from " + date);
  if (info.first_cycle) {
    const char* const end =
        info.stats && info.stats->is_final != 0 ? "" : "; the run did not end in it";
    fmt::print(out, "  run {}, cycles {} to {}{}\n", info.run_id.empty() ? "?" : info.run_id,
               *info.first_cycle, *info.last_cycle, end);
  }
  Json json{{"kind", "log"},
            {"files", files},
            {"messages", info.messages},
            {"duration_s", info.duration_s},
            {"first_utime", info.first_utime},
            {"run_id", info.run_id},
            {"first_cycle", json_of(info.first_cycle)},
            {"last_cycle", json_of(info.last_cycle)},
            {"ended", info.stats && info.stats->is_final != 0},
            {"undecodable", info.undecodable},
            {"channels", Json::object()},
            {"parts", Json::array()},
            {"verdicts", Json::array()},
            {"stats", nullptr},
            {"damages", Json::array()}};
  for (const auto& [name, channel] : info.channels) {
    fmt::print(out, "  {:<22} {:>9} messages {:>12} bytes{}\n", name, channel.messages,
               channel.bytes,
               channel.missing > 0 ? fmt::format("  {} MISSING", channel.missing) : "");
    json["channels"][name] = {
        {"messages", channel.messages}, {"bytes", channel.bytes}, {"missing", channel.missing}};
  }
  for (const LogInfo::Part& part : info.parts) {
    fmt::print(out, "  {:<12} {} ({}){}\n", part.part, part.name, part.digest,
               part.is_complete ? "" : " INCOMPLETE");
    json["parts"].push_back({{"part", part.part},
                             {"name", part.name},
                             {"digest", part.digest},
                             {"complete", part.is_complete}});
  }
  for (const LogInfo::VerdictChange& change : info.verdicts) {
    json["verdicts"].push_back(print_verdict(out, change));
  }
  if (info.stats) json["stats"] = print_stats(out, *info.stats);
  if (info.undecodable > 0) {
    fmt::print(out, "  {} messages on our channels are not of our types\n", info.undecodable);
  }
  for (const FileDamage& damage : info.damages) {
    fmt::print(out, "  {}\n", describe(damage.file, damage.damage));
    json["damages"].push_back({{"file", damage.file},
                               {"offset", damage.damage.offset},
                               {"bytes", damage.damage.bytes},
                               {"what", damage.damage.what}});
  }
  return json;
}

struct InfoArguments {
  std::vector<std::string> files;
  std::string json;
};

int info(const InfoArguments& arguments) {
  const Json json = print_log_info(human_output(arguments.json), arguments.files);
  if (!arguments.json.empty()) write_json(json, arguments.json);
  return kExitYes;
}

}  // namespace

Json print_log_info(std::FILE* out, const std::vector<std::string>& files) {
  return print_info(out, files, read_log_info(files));
}

void add_log_info_command(CLI::App& parent, int& exit_code) {
  CLI::App* command = parent.add_subcommand(
      "info", "What a log contains: channels, parts, verdicts, counters, latencies, damage");
  auto arguments = std::make_shared<InfoArguments>();
  add_log_files(*command, arguments->files);
  add_json_option(*command, arguments->json);
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = info(*arguments); });
}

}  // namespace faultline

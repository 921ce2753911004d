#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/bench/plant_process.h"
#include "tools/cli.h"
#include "tools/lcm/lcm_url.h"
#include "tools/node_commands.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

struct PlantArguments {
  std::string scenario, bus, log, lcm_url, json;
  std::string overrun = "catch-up";
  double seconds = 0.0;
  bool is_endless = false, is_quiet = false;
};

const std::map<std::string, OverrunPolicy> kOverrunPolicies{{"catch-up", OverrunPolicy::kCatchUp},
                                                            {"skip", OverrunPolicy::kSkip},
                                                            {"stop", OverrunPolicy::kStop}};

std::uint32_t cycle_count(const PlantArguments& arguments, const BenchInputs& inputs) {
  constexpr std::uint32_t kMost = std::numeric_limits<std::uint32_t>::max();
  if (arguments.is_endless) return kMost;
  const double seconds = arguments.seconds > 0.0 ? arguments.seconds : inputs.scenario.duration_s;
  const double cycles = std::round(seconds / inputs.bank.sample_time_s) + 1.0;
  return cycles < kMost ? static_cast<std::uint32_t>(cycles) : kMost;
}

void print_end(std::FILE* out, const PlantArguments& arguments, const BenchInputs& inputs,
               const PlantProcessResult& result) {
  const RunCounters& counters = result.counters;
  fmt::print(out, "{} on {}: {} cycles, {} late, {} overruns; frames: {} sent, {} refused\n",
             inputs.scenario.name, arguments.bus, counters.cycles, counters.late_cycles,
             counters.overruns, counters.frames_sent, counters.send_errors);
  for (const ActedFault& fault : result.faults) {
    fmt::print(out, "  fault    {} on {} from cycle {} ({:.6g} s)\n", fault.kind, fault.target,
               fault.from_cycle, fault.from_cycle * inputs.bank.sample_time_s);
  }
  if (!arguments.log.empty()) fmt::print(out, "  log      {}\n", arguments.log);
  if (result.stop_reason) {
    std::fflush(out);
    fmt::print(stderr, "faultline: {}\n", result.stop_reason->text);
  }
}

Json result_json(const PlantArguments& arguments, const BenchInputs& inputs,
                 const PlantProcessResult& result) {
  const RunCounters& counters = result.counters;
  Json json{{"scenario", inputs.scenario.name},
            {"bus", arguments.bus},
            {"cycles", counters.cycles},
            {"late_cycles", counters.late_cycles},
            {"overruns", counters.overruns},
            {"skipped_cycles", counters.skipped_cycles},
            {"records_dropped", counters.records_dropped},
            {"clamped_values", counters.clamped_values},
            {"silences", result.silences},
            {"frames",
             {{"sent", counters.frames_sent},
              {"refused", counters.send_errors},
              {"received", counters.frames_received},
              {"dropped", counters.frames_dropped}}},
            {"faults", Json::array()}};
  for (const ActedFault& fault : result.faults) {
    json["faults"].push_back(
        {{"target", fault.target}, {"kind", fault.kind}, {"from_cycle", fault.from_cycle}});
  }
  json["signal"] = result.signal;
  json["stop_reason"] = result.stop_reason ? Json(result.stop_reason->text) : Json(nullptr);
  json["log"] = arguments.log.empty() ? Json(nullptr) : Json(arguments.log);
  return json;
}

int answer(const PlantProcessResult& result) {
  if (!result.stop_reason) return kExitYes;
  return result.stop_reason->kind == StopReason::Kind::kPlant ? kExitNo : kExitFailure;
}

int run(const PlantArguments& arguments) {
  if (!arguments.lcm_url.empty()) check_lcm_url(arguments.lcm_url);
  const BenchInputs inputs = load_bench_inputs(arguments.scenario);
  std::FILE* const out = human_output(arguments.json);
  PlantProcessOptions options;
  options.bus = arguments.bus;
  options.cycle_count = cycle_count(arguments, inputs);
  options.overrun = kOverrunPolicies.at(arguments.overrun);
  if (!arguments.log.empty()) options.log = arguments.log;
  if (!arguments.lcm_url.empty()) options.lcm_url = arguments.lcm_url;
  if (!arguments.is_quiet) {
    options.on_line = [out](double t_s, const std::string& text) {
      fmt::print(out, "  {:8.2f} s  {}\n", t_s, text);
      std::fflush(out);
    };
  }
  const PlantProcessResult result = run_plant_process(inputs, options);
  print_end(out, arguments, inputs, result);
  if (!arguments.json.empty()) write_json(result_json(arguments, inputs, result), arguments.json);
  return answer(result);
}

}  // namespace

void add_plant_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "plant", "Simulate the plant alone, in real time: the other nodes are elsewhere on the bus");
  auto arguments = std::make_shared<PlantArguments>();
  command->add_option("SCENARIO", arguments->scenario, "Scenario file (.toml)")
      ->required()
      ->check(CLI::ExistingFile);
  command->add_option("--bus", arguments->bus, "can:IFACE, udp:GROUP:PORT")->required();
  auto* seconds = command
                      ->add_option("--for", arguments->seconds,
                                   "End after so many seconds; default: the scenario's duration")
                      ->check(CLI::PositiveNumber)
                      ->check(check_finite);
  command->add_flag("--forever", arguments->is_endless, "End at SIGINT or SIGTERM only")
      ->excludes(seconds);
  command
      ->add_option("--overrun", arguments->overrun,
                   "A cycle a whole period late: catch-up (it and the next follow at once), skip "
                   "(simulated but not sent), stop (end, exit code 3)")
      ->check(CLI::IsMember({"catch-up", "skip", "stop"}))
      ->capture_default_str();
  command->add_option("--log", arguments->log,
                      "LCM log to write: TRUTH, EVENT, STATS; default: none. An existing log is "
                      "replaced");
  command->add_option("--lcm", arguments->lcm_url,
                      "Publish them live as well, and take the requests of `faultline inject`, "
                      "e.g. udpm://239.255.76.67:7667?ttl=0");
  command->add_flag("-q,--quiet", arguments->is_quiet, "No lines while it runs");
  add_json_option(*command, arguments->json);
  command->footer(
      "Cycle k begins at absolute deadlines, one sample time of the bank after the other, whoever "
      "answers. Of the scenario's faults those of the plant act: on actuators, sensors and "
      "components, and on the frames and signals that it sends.\nExit codes: 0 it ran, whatever "
      "ended it; 1 the plant diverged; 2 bad input or usage; 3 the bus, the log or LCM failed.");
  command->callback([arguments, &exit_code] { exit_code = run(*arguments); });
}

}  // namespace faultline

#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/bench/controller_process.h"
#include "tools/cli.h"
#include "tools/node_commands.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

struct ControllerArguments {
  std::string scenario, bus, json;
  std::optional<double> seconds;
  bool is_quiet = false;
};

int run(const ControllerArguments& arguments) {
  const BenchInputs inputs = load_bench_inputs(arguments.scenario);
  std::FILE* const out = human_output(arguments.json);
  ControllerProcessOptions options;
  options.bus = arguments.bus;
  options.seconds = arguments.seconds;
  if (!arguments.is_quiet) {
    options.on_line = [out](double t_s, const std::string& text) {
      fmt::print(out, "  {:8.2f} s  {}\n", t_s, text);
      std::fflush(out);
    };
  }
  const ControllerProcessResult result = run_controller_process(inputs, options);
  const BusCounters& bus = result.bus;
  fmt::print(out,
             "{} on {}: {} cycles, the plant began anew {} times; frames: {} sent, {} refused\n",
             inputs.scenario.name, arguments.bus, result.cycles, result.restarts, bus.sent,
             bus.send_errors);
  if (!arguments.json.empty()) {
    write_json(Json{{"scenario", inputs.scenario.name},
                    {"bus", arguments.bus},
                    {"cycles", result.cycles},
                    {"restarts", result.restarts},
                    {"silences", result.silences},
                    {"clamped_values", result.clamped_values},
                    {"frames",
                     {{"sent", bus.sent},
                      {"refused", bus.send_errors},
                      {"received", bus.received},
                      {"dropped", bus.dropped}}},
                    {"signal", result.signal}},
               arguments.json);
  }
  return result.cycles > 0 ? kExitYes : kExitNo;
}

}  // namespace

void add_controller_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "controller", "Control the plant of a bus: each measurement is answered with commands");
  auto arguments = std::make_shared<ControllerArguments>();
  command->add_option("SCENARIO", arguments->scenario, "Scenario file (.toml)")
      ->required()
      ->check(CLI::ExistingFile);
  command->add_option("--bus", arguments->bus, "can:IFACE, udp:GROUP:PORT")->required();
  command->add_option("--for", arguments->seconds, "End after so many seconds; default: never")
      ->check(CLI::PositiveNumber)
      ->check(check_finite);
  command->add_flag("-q,--quiet", arguments->is_quiet, "No lines while it runs");
  add_json_option(*command, arguments->json);
  command->footer(
      "Ends by --for, SIGINT or SIGTERM. Of the scenario's faults those of the controller act: on "
      "the frames and signals that it sends.\nExit codes: 0 it answered, whatever ended it; 1 "
      "there was no measurement; 2 bad input or usage; 3 the bus failed.");
  command->callback([arguments, &exit_code] { exit_code = run(*arguments); });
}

}  // namespace faultline

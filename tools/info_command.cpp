#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_file.h"
#include "diagnosis/model/toml_reader.h"
#include "drivers/dbc/dbc_parser.h"
#include "tools/bank_print.h"
#include "tools/bench/scenario.h"
#include "tools/bench/scenario_files.h"
#include "tools/can/dbc_print.h"
#include "tools/cli.h"
#include "tools/controller_print.h"
#include "tools/log/log_command.h"
#include "tools/scenario_print.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

Json info_of_bank(const std::filesystem::path& file, std::FILE* out) {
  const Bank bank = read_bank(file);
  fmt::print(out, "{}: bank \"{}\" for plant \"{}\" ({})\n", file.string(), bank.name,
             bank.plant_name, bank.plant_digest);
  print_bank(out, bank);
  return Json::parse(bank_text(bank));
}

Json info_of_plant(const std::filesystem::path& file, std::FILE* out) {
  const PlantModel plant = read_plant(file);
  fmt::print(out, "{}: plant \"{}\", {}, {} states, {} inputs, {} outputs\n", file.string(),
             plant.name, plant.time == TimeDomain::kContinuous ? "continuous" : "discrete",
             plant.n(), plant.m(), plant.q());
  fmt::print(out, "  inputs   {}\n  outputs  {}\n  faults   {}\n",
             fmt::join(plant.input_names, ", "), fmt::join(plant.output_names, ", "),
             fmt::join(plant.fault_names(), ", "));
  return {{"kind", "plant"},
          {"name", plant.name},
          {"states", plant.state_names},
          {"inputs", plant.input_names},
          {"outputs", plant.output_names},
          {"faults", plant.fault_names()},
          {"digest", plant_digest(plant)}};
}

Json info_of_request(const std::filesystem::path& file, std::FILE* out) {
  const BankRequest request = read_bank_request(file);
  fmt::print(out,
             "{}: asks for bank \"{}\" by method {} for plant {}\n  up to {} faults at a time, one "
             "step every {:g} s; `faultline design {}` makes it\n",
             file.string(), request.name, request.method, request.plant.string(),
             request.concurrent, request.sample_time_s, file.string());
  return {{"kind", "bank_request"},           {"name", request.name},
          {"method", request.method},         {"plant", request.plant.string()},
          {"concurrent", request.concurrent}, {"sample_time_s", request.sample_time_s}};
}

Json info_of_scenario(const std::filesystem::path& file, std::FILE* out) {
  const Scenario scenario = read_scenario(file);
  print_scenario(out, scenario);
  Json json = scenario_json(scenario);
  json["controller"] = print_controller(out, scenario);
  return json;
}

Json info_of_part(const std::filesystem::path& file, std::FILE* out) {
  const std::vector<std::string> keys = TomlTable::read_file(file).keys();
  fmt::print(out, "{}: a part that scenarios include: {}\n", file.string(), fmt::join(keys, ", "));
  return {{"kind", "scenario_part"}, {"keys", keys}};
}

Json info_of_toml(const std::filesystem::path& file, std::FILE* out) {
  switch (kind_of_toml(file)) {
    case TomlKind::kPlant:
      return info_of_plant(file, out);
    case TomlKind::kBankRequest:
      return info_of_request(file, out);
    case TomlKind::kScenario:
      return info_of_scenario(file, out);
    case TomlKind::kPart:
      return info_of_part(file, out);
    case TomlKind::kUnknown:
      break;
  }
  throw TomlTable::read_file(file).error(
      "",
      "found none of the keys dynamics, method, duration_s, expected a plant, a bank request or a "
      "scenario");
}

int info(const std::string& name, const std::string& json_target) {
  const std::filesystem::path file(name);
  std::FILE* out = human_output(json_target);
  const std::string extension = file.extension().string();
  Json json;
  if (extension == ".dbc") {
    const DbcDatabase dbc = read_dbc(file);
    print_dbc(out, dbc);
    if (!json_target.empty()) {
      write_to(json_target, [&](std::FILE* target) { write_dbc_json(target, dbc); });
    }
    return kExitYes;
  }
  if (extension == ".json") {
    json = info_of_bank(file, out);
  } else if (extension == ".toml") {
    json = info_of_toml(file, out);
  } else {
    json = print_log_info(out, {name});
  }
  if (!json_target.empty()) write_json(json, json_target);
  return kExitYes;
}

}  // namespace

void add_info_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "info", "Tell what a file is: plant, bank request, bank, scenario, DBC or LCM log");
  auto file = std::make_shared<std::string>();
  auto json_target = std::make_shared<std::string>();
  command->add_option("FILE", *file, ".toml, .bank.json, .dbc; anything else is read as an LCM log")
      ->required()
      ->check(CLI::ExistingFile);
  add_json_option(*command, *json_target);
  command->footer(kExitCodesHelp);
  command->callback([file, json_target, &exit_code] { exit_code = info(*file, *json_target); });
}

}  // namespace faultline

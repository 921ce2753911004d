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
#include "tools/can/dbc_print.h"
#include "tools/cli.h"
#include "tools/controller_print.h"
#include "tools/log/log_command.h"

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

/// What an entry does besides its kind: " 0.1", " at its bound", " sigma 0.2, 1 to 5 Hz", ..
std::string perturbation_words(const Perturbation& perturbation) {
  using enum PerturbationKind;
  const auto or_else = [](const std::optional<double>& number, const char* words) {
    return number ? fmt::format("{:g}", *number) : std::string(words);
  };
  switch (perturbation.kind) {
    case kGaussian:
      return "sigma " + or_else(perturbation.sigma, "of the plant file");
    case kBandLimited:
      return fmt::format("sigma {}, {:g} to {:g} Hz",
                         or_else(perturbation.sigma, "of the plant file"), perturbation.from_Hz,
                         perturbation.to_Hz);
    case kRecorded:
      return fmt::format("{} times {} of {}{}", or_else(perturbation.size, "1"),
                         perturbation.column.empty() ? "its column" : perturbation.column,
                         perturbation.file.string(),
                         perturbation.is_repeated ? ", again and again" : "");
    case kSinusoid:
      return fmt::format("{}, {:g} Hz", or_else(perturbation.size, "at its bound"),
                         perturbation.frequency_Hz);
    default:
      return or_else(perturbation.size, "at its bound");
  }
}

/// [[disturbance]] or [[noise]], as `what` says.
Json info_of_perturbations(const std::vector<Perturbation>& perturbations, const char* what,
                           std::FILE* out) {
  Json json = Json::array();
  for (const Perturbation& perturbation : perturbations) {
    fmt::print(out, "  {} {} {} {} from {:g} s{}\n", what, perturbation.target,
               perturbation_kind_name(perturbation.kind), perturbation_words(perturbation),
               perturbation.at_s,
               perturbation.until_s ? fmt::format(" until {:g} s", *perturbation.until_s) : "");
    json.push_back({{"target", perturbation.target},
                    {"kind", perturbation_kind_name(perturbation.kind)},
                    {"size", perturbation.size ? Json(*perturbation.size) : Json(nullptr)},
                    {"at_s", perturbation.at_s}});
  }
  return json;
}

/// What an entry of the timeline has besides target, kind and value.
std::string timeline_words(const Injection& injection) {
  std::string words = fmt::format(" from {:g} s", injection.at_s);
  const auto append = [&words](bool is_there, const std::string& text) {
    if (is_there) words += text;
  };
  append(injection.until_s.has_value(),
         fmt::format(" until {:g} s", injection.until_s.value_or(0)));
  append(injection.ramp_s > 0.0, fmt::format(", over {:g} s", injection.ramp_s));
  append(injection.period_s.has_value(),
         fmt::format(", in the first half of every {:g} s", injection.period_s.value_or(0)));
  append(injection.spread_s > 0.0, fmt::format(", up to {:g} s later", injection.spread_s));
  append(injection.probability < 1.0,
         fmt::format(", in {:g} % of the cycles", 100.0 * injection.probability));
  append(injection.frequency_Hz > 0.0, fmt::format(", {:g} Hz", injection.frequency_Hz));
  append(!injection.with.empty(), " with " + injection.with);
  return words;
}

Json info_of_injection(const Injection& injection, std::FILE* out) {
  fmt::print(out, "  fault {:<8} {}{}{}\n", injection.target, injection_kind_name(injection.kind),
             injection.value ? fmt::format(" {:g}", *injection.value) : "",
             timeline_words(injection));
  const auto or_null = [](const std::optional<double>& number) {
    return number ? Json(*number) : Json(nullptr);
  };
  Json json{{"target", injection.target},
            {"kind", injection_kind_name(injection.kind)},
            {"value", or_null(injection.value)},
            {"at_s", injection.at_s},
            {"until_s", or_null(injection.until_s)},
            {"ramp_s", injection.ramp_s},
            {"period_s", or_null(injection.period_s)},
            {"spread_s", injection.spread_s},
            {"probability", injection.probability}};
  if (injection.kind == InjectionKind::kSinusoid) {
    json["frequency_Hz"] = injection.frequency_Hz;
    json["phase_rad"] = injection.phase_rad;
  }
  if (!injection.with.empty()) json["with"] = injection.with;
  return json;
}

Json info_of_scenario(const std::filesystem::path& file, std::FILE* out) {
  const Scenario scenario = read_scenario(file);
  fmt::print(out, "{}: scenario \"{}\", {:g} s\n  plant {}\n  bank  {}\n  dbc   {}\n",
             file.string(), scenario.name, scenario.duration_s, scenario.plant.string(),
             scenario.bank.string(), scenario.dbc.string());
  Json json{{"kind", "scenario"},
            {"name", scenario.name},
            {"duration_s", scenario.duration_s},
            {"plant", scenario.plant.string()},
            {"bank", scenario.bank.string()},
            {"dbc", scenario.dbc.string()},
            {"faults", Json::array()},
            {"expectations", scenario.expectations.size()}};
  json["controller"] = print_controller(out, scenario);
  for (const Injection& injection : scenario.injections) {
    json["faults"].push_back(info_of_injection(injection, out));
  }
  json["disturbances"] = info_of_perturbations(scenario.disturbances, "disturbance", out);
  json["noises"] = info_of_perturbations(scenario.noises, "noise", out);
  for (const Expectation& expectation : scenario.expectations) {
    fmt::print(out, "  expects {}\n", expectation_words(expectation));
  }
  return json;
}

Json info_of_toml(const std::filesystem::path& file, std::FILE* out) {
  const TomlTable root = TomlTable::read_file(file);
  if (root.has("dynamics")) return info_of_plant(file, out);
  if (root.has("method")) return info_of_request(file, out);
  if (root.has("duration_s")) return info_of_scenario(file, out);
  throw root.error("",
                   "found none of the keys dynamics, method, duration_s, expected a plant, a "
                   "bank request or a scenario");
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

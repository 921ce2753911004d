#include "tools/bench/bench_inputs.h"

#include <algorithm>
#include <fstream>
#include <functional>
#include <iterator>
#include <system_error>

#include <fmt/format.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/plant_file.h"
#include "diagnosis/model/toml_reader.h"
#include "drivers/dbc/dbc_parser.h"
#include "tools/bench/bank_cache.h"
#include "tools/bench/bench_parts.h"
#include "tools/bench/controller_plan.h"

namespace faultline {
namespace {

/// Cycles are counted in 32 bits on the bus, and the largest number says "no command yet".
constexpr double kMaxCycles = kNoCommand;

/// The file that the scenario names under `key`.
const std::filesystem::path& require_file(const Scenario& scenario, std::string_view key,
                                          const std::filesystem::path& file) {
  std::error_code error;
  const auto type = std::filesystem::status(file, error).type();
  if (type == std::filesystem::file_type::not_found) {
    throw scenario_error(scenario, "", key,
                         fmt::format("{}: found no file {}, expected one", key, file.string()));
  }
  if (type == std::filesystem::file_type::directory) {
    throw scenario_error(
        scenario, "", key,
        fmt::format("{}: found the folder {}, expected a file", key, file.string()));
  }
  return file;
}

/// The plant that a bank request names must be the scenario's.
void check_request_fits(const Scenario& scenario, const PlantModel& plant,
                        const BankRequest& request) {
  std::error_code error;
  if (std::filesystem::equivalent(request.plant, scenario.plant, error)) return;
  const PlantModel other = read_requested_plant(request);
  if (plant_digest(other) == plant_digest(plant)) return;
  throw request_error(request, "plant",
                      fmt::format("found {} (plant \"{}\"), expected the plant \"{}\" that {} is "
                                  "about: {}",
                                  request.plant.string(), other.name, plant.name,
                                  scenario.file.string(), scenario.plant.string()));
}

Bank load_bank(const Scenario& scenario, const PlantModel& plant, std::vector<RunPart>& parts) {
  require_file(scenario, "bank", scenario.bank);
  const std::string name = scenario.bank.filename().string();
  if (scenario.bank.extension() == ".json") {
    parts.push_back(read_part("bank", scenario.bank));
    return load_bank_file(scenario.bank);
  }
  const BankRequest request = read_bank_request(scenario.bank);
  check_request_fits(scenario, plant, request);
  Bank bank = cached_design(plant, request);
  parts.push_back({"bank_request", name, request.text});
  parts.push_back({"bank", bank.name + ".bank.json", bank_text(bank)});
  return bank;
}

/// Where `key` stands in a bank file, which has it once.
SourcePosition position_in_bank(const Scenario& scenario, std::string_view key) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(scenario.bank, error)) return {};  // it came with a log
  const std::string text = read_part("bank", scenario.bank).text;
  const std::size_t offset = text.find(fmt::format("\"{}\"", key));
  if (offset == std::string::npos) return {};
  const auto begin = text.begin();
  const auto at = begin + static_cast<std::ptrdiff_t>(offset);
  const std::size_t line_start = text.rfind('\n', offset) + 1;  // npos + 1 is 0
  return {static_cast<int>(std::count(begin, at, '\n')) + 1,
          static_cast<int>(offset - line_start) + 1};
}

void check_bank_fits(const Scenario& scenario, const PlantModel& plant, const Bank& bank) {
  const std::string digest = plant_digest(plant);
  if (bank.plant_digest != digest) {
    throw InputError(scenario.bank.string(), position_in_bank(scenario, "plant"),
                     fmt::format("plant: found digest {} (designed for plant \"{}\"), expected {}, "
                                 "that of plant \"{}\" in {}: design the bank anew",
                                 bank.plant_digest, bank.plant_name, digest, plant.name,
                                 scenario.plant.string()));
  }
  const auto check_names = [&](const char* key, const std::vector<std::string>& found,
                               const std::vector<std::string>& expected) {
    if (found == expected) return;
    throw InputError(scenario.bank.string(), position_in_bank(scenario, key),
                     fmt::format("{}: found {}, expected those of plant \"{}\": {}", key,
                                 fmt::join(found, ", "), plant.name, fmt::join(expected, ", ")));
  };
  check_names("inputs", bank.input_names, plant.input_names);
  check_names("outputs", bank.output_names, plant.output_names);
  check_names("faults", bank.fault_names, plant.fault_names());
}

void check_duration(const Scenario& scenario, const Bank& bank) {
  const double cycles = scenario.duration_s / bank.sample_time_s;
  if (cycles >= 1.0 && cycles < kMaxCycles) return;
  throw scenario_error(
      scenario, "", "duration_s",
      fmt::format("duration_s: found {} s, {} cycles of {} s (sample_time_s of bank "
                  "\"{}\"), expected 1 to {} cycles",
                  scenario.duration_s, cycles, bank.sample_time_s, bank.name, kMaxCycles));
}

/// What one [[expect]] calls by names.
struct ExpectedNames {
  const char* key;
  std::vector<std::string> names;
};

/// @throws InputError the first that is not one of `known`, which are `what`.
void check_expected_names(const Scenario& scenario, std::size_t entry, const ExpectedNames& found,
                          const std::vector<std::string>& known, const std::string& what) {
  for (const std::string& name : found.names) {
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    const auto near = nearest_name(name, known);
    throw scenario_error(scenario, "expect", found.key,
                         fmt::format("{}: found \"{}\", expected {} ({}){}", found.key, name, what,
                                     fmt::join(known, ", "),
                                     near ? fmt::format("; did you mean \"{}\"?", *near) : ""),
                         entry);
  }
}

void check_expectations(const Scenario& scenario, const Bank& bank, const SignalMap& map) {
  std::vector<std::string> messages;
  for (std::size_t i = 0; i < map.message_count(); ++i) messages.push_back(map.message_name(i));
  for (std::size_t i = 0; i < scenario.expectations.size(); ++i) {
    const Expectation& expectation = scenario.expectations[i];
    ExpectedNames sets{"sets", {}};
    for (const auto& set : expectation.sets) {
      sets.names.insert(sets.names.end(), set.begin(), set.end());
    }
    const std::string fault = fmt::format("a fault of bank \"{}\"", bank.name);
    check_expected_names(scenario, i, {"faults", expectation.faults}, bank.fault_names, fault);
    check_expected_names(scenario, i, sets, bank.fault_names, fault);
    check_expected_names(scenario, i, {"blame", expectation.blamed}, messages,
                         "a message that carries channels or SYNC");
  }
}

/// The bench's own controller must tell cycles apart; one that only listens could go by bus order.
void check_cycles_can_be_told(const DbcDatabase& dbc, const SignalMap& map) {
  if (map.sync) return;
  for (const MappedMessage& message : map.sensor_messages) {
    if (message.cycle) continue;
    const auto in_file =
        std::find_if(dbc.messages.begin(), dbc.messages.end(),
                     [&](const DbcMessage& candidate) { return candidate.name == message.name; });
    throw InputError(dbc.source, {in_file->position.line, in_file->position.column},
                     fmt::format("message {}: found no signal with FaultlineRole \"cycle\" and no "
                                 "message with \"sync\", expected one: the simulated controller "
                                 "cannot tell cycles apart",
                                 message.name));
  }
}

/// A mapping that names no signal of the DBC is the scenario's mistake: the message points there.
SignalMap map_signals(const Scenario& scenario, const DbcDatabase& dbc, const PlantModel& plant) {
  try {
    SignalMap map = make_signal_map(dbc, plant.output_names, plant.input_names, scenario.signals);
    set_rates(scenario, map);
    return map;
  } catch (const SignalMapError& error) {
    if (error.mapped_channel().empty()) throw;
    throw scenario_error(scenario, "signals", error.mapped_channel(),
                         fmt::format("signals: {}", error.what()));
  }
}

/// [signals] may map channels only. What they are mapped to, make_signal_map checks.
void check_mapped_channels(const Scenario& scenario, const PlantModel& plant) {
  std::vector<std::string> channels = plant.output_names;
  channels.insert(channels.end(), plant.input_names.begin(), plant.input_names.end());
  for (const auto& [channel, mapping] : scenario.signals) {
    if (std::find(channels.begin(), channels.end(), channel) != channels.end()) continue;
    const auto near = nearest_name(channel, channels);
    throw scenario_error(
        scenario, "signals", channel,
        fmt::format("signals: found \"{}\", expected a channel of plant \"{}\" ({}){}", channel,
                    plant.name, fmt::join(channels, ", "),
                    near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
  }
}

/// The part of RUN that says which library the command line named.
constexpr char kPlantLibraryPart[] = "plant_library";

void override_plant(Scenario& scenario, const std::filesystem::path& library) {
  SimulationSpec& simulation = scenario.simulation;
  simulation.model.clear();
  simulation.library = library;
  simulation.is_library_override = true;
}

/// What a scenario refers to.
struct ScenarioTexts {
  RunPart plant, dbc;
  std::optional<RunPart> commands;                        ///< of a recorded controller
  std::string plant_source, dbc_source, commands_source;  ///< names for messages
  std::vector<RunPart> data;                              ///< records that a log carries
};
using BankLoader = std::function<Bank(const Scenario&, const PlantModel&, std::vector<RunPart>&)>;

void set_controller(BenchInputs& inputs, const Scenario& scenario,
                    const std::optional<NamedText>& commands) {
  ControllerPlan controller =
      plan_controller(scenario, inputs.plant, inputs.bank.sample_time_s, commands);
  inputs.make_controller = std::move(controller.make);
  inputs.warnings = std::move(controller.warnings);
}

// What the bank's thresholds do not stand for.
void note_thresholds(BenchInputs& inputs) {
  using Kind = ThresholdBasis::Kind;
  const Bank& bank = inputs.bank;
  if (bank.thresholds.kind == Kind::kCalibrated &&
      std::none_of(bank.filters.begin(), bank.filters.end(),
                   [](const ResidualFilter& filter) { return filter.calibration.has_value(); })) {
    inputs.warnings.push_back(
        fmt::format("the thresholds of bank \"{}\" are provisional: faultline calibrate sets them "
                    "from fault-free "
                    "logs",
                    bank.name));
  }
  if (bank.thresholds.kind != Kind::kCertified) return;
  for (std::size_t i = 0; i < bank.output_names.size(); ++i) {
    const double reckoned = bank.thresholds.output_resolution.size() == 0
                                ? 0.0
                                : bank.thresholds.output_resolution[static_cast<Eigen::Index>(i)];
    const double found = inputs.map.output_resolution[i];
    // A signal's factor times its scale is rounded itself.
    if (found > (1.0 + 1e-9) * reckoned) {
      inputs.warnings.push_back(
          fmt::format("{} is rounded to {:g} on the bus, the certified thresholds of bank \"{}\" "
                      "reckon with {:g}: "
                      "resolution in its [decision]",
                      bank.output_names[i], found, bank.name, reckoned));
    }
  }
}

BenchInputs fit_together(Scenario scenario, const ScenarioTexts& texts, const BankLoader& load) {
  BenchInputs inputs;
  inputs.name = scenario.name;
  inputs.is_initial_state_known = scenario.is_initial_state_known;
  inputs.plant = parse_plant(texts.plant.text, texts.plant_source);
  const DbcDatabase dbc = parse_whole_dbc(texts.dbc.text, texts.dbc_source);
  inputs.parts = {{"scenario", scenario.file.filename().string(), scenario.text}};
  for (const IncludedText& include : scenario.includes) {
    inputs.parts.push_back(include_part(include));
  }
  inputs.parts.insert(inputs.parts.end(), {texts.plant, texts.dbc});
  if (texts.commands) inputs.parts.push_back(*texts.commands);
  inputs.parts.insert(inputs.parts.end(), texts.data.begin(), texts.data.end());
  check_mapped_channels(scenario, inputs.plant);
  inputs.map = map_signals(scenario, dbc, inputs.plant);
  check_cycles_can_be_told(dbc, inputs.map);
  inputs.bank = load(scenario, inputs.plant, inputs.parts);
  check_bank_fits(scenario, inputs.plant, inputs.bank);
  check_expectations(scenario, inputs.bank, inputs.map);
  check_duration(scenario, inputs.bank);
  inputs.make_plant = plant_maker(scenario, inputs.plant, {texts.plant.text, texts.plant_source},
                                  inputs.bank.sample_time_s);
  inputs.x_initial = initial_state(scenario, inputs.plant);
  make_schedules(inputs, scenario);
  std::optional<NamedText> commands;
  if (texts.commands) commands = {texts.commands->text, texts.commands_source};
  set_controller(inputs, scenario, commands);
  note_thresholds(inputs);
  inputs.dbc_warnings = warnings_of(dbc);
  inputs.scenario = std::move(scenario);
  return inputs;
}

const RunPart& require_part(const std::vector<RunPart>& parts, std::string_view name,
                            const std::string& log) {
  if (const RunPart* part = find_part(parts, name)) return *part;
  throw InputError(log, {},
                   fmt::format("RUN: found no whole part \"{}\", expected one: the log does not "
                               "carry what the run was made from",
                               name));
}

/// The records among the parts of a log: data_text takes them from there.
std::vector<RunPart> data_of(const std::vector<RunPart>& parts) {
  std::vector<RunPart> data;
  std::copy_if(parts.begin(), parts.end(), std::back_inserter(data),
               [](const RunPart& part) { return part.part.starts_with("data:"); });
  return data;
}

}  // namespace

PlantModel read_requested_plant(const BankRequest& request) {
  std::error_code error;
  if (!std::filesystem::exists(request.plant, error) ||
      std::filesystem::is_directory(request.plant, error)) {
    throw request_error(request, "plant",
                        fmt::format("found no file {}, expected one", request.plant.string()));
  }
  return read_plant(request.plant);
}

BenchInputs load_bench_inputs(const std::filesystem::path& scenario_file,
                              const std::filesystem::path& plant_library) {
  return load_bench_inputs(read_scenario(scenario_file), plant_library);
}

BenchInputs load_bench_inputs(Scenario scenario, const std::filesystem::path& plant_library) {
  if (!plant_library.empty()) override_plant(scenario, plant_library);
  ScenarioTexts texts;
  texts.plant = read_part("plant", require_file(scenario, "plant", scenario.plant));
  texts.plant_source = scenario.plant.string();
  texts.dbc = read_part("dbc", require_file(scenario, "dbc", scenario.dbc));
  texts.dbc_source = scenario.dbc.string();
  texts.commands = read_commands(scenario);
  texts.commands_source = scenario.controller.commands.string();
  BenchInputs inputs = fit_together(std::move(scenario), texts, load_bank);
  if (!plant_library.empty()) {
    inputs.parts.push_back(
        {kPlantLibraryPart, plant_library.filename().string(), plant_library.string()});
  }
  return inputs;
}

BenchInputs vary_bench_inputs(const BenchInputs& base, Scenario scenario,
                              const std::set<std::string, std::less<>>& changed) {
  BenchInputs inputs = base;
  inputs.name = scenario.name;
  inputs.is_initial_state_known = scenario.is_initial_state_known;
  const auto written = std::find_if(inputs.parts.begin(), inputs.parts.end(),
                                    [](const RunPart& part) { return part.part == "scenario"; });
  written->text = scenario.text;
  check_expectations(scenario, inputs.bank, inputs.map);
  check_duration(scenario, inputs.bank);
  if (changed.contains("simulation")) {
    inputs.make_plant = plant_maker(
        scenario, inputs.plant, {find_part(inputs.parts, "plant")->text, scenario.plant.string()},
        inputs.bank.sample_time_s);
  }
  inputs.x_initial = initial_state(scenario, inputs.plant);
  make_schedules(inputs, scenario);
  const bool is_longer_record =
      changed.contains("duration_s") && scenario.controller.kind == ControllerKind::kRecorded;
  if (changed.contains("controller") || changed.contains("reference") || is_longer_record) {
    std::optional<NamedText> commands;
    if (const auto part = read_commands(scenario)) {
      commands = {part->text, scenario.controller.commands.string()};
    }
    set_controller(inputs, scenario, commands);
  }
  inputs.scenario = std::move(scenario);
  return inputs;
}

BenchInputs bench_inputs_of_parts(const std::vector<RunPart>& parts, const std::string& log) {
  const auto source = [&log](const RunPart& part) { return log + ":" + part.name; };
  const RunPart& bank = require_part(parts, "bank", log);
  const RunPart& dbc = require_part(parts, "dbc", log);
  const auto load_bank = [&] { return parse_bank(bank.text, source(bank)); };
  BenchInputs inputs;
  if (const RunPart* text = find_part(parts, "scenario")) {
    const RunPart& plant = require_part(parts, "plant", log);
    Scenario scenario = parse_scenario(text->text, source(*text), included_texts(parts));
    if (const RunPart* library = find_part(parts, kPlantLibraryPart)) {
      override_plant(scenario, library->text);
    }
    scenario.simulation.is_library_at_hand = false;
    scenario.plant = source(plant);
    scenario.dbc = source(dbc);
    scenario.bank = source(bank);
    ScenarioTexts texts{plant, dbc, std::nullopt, source(plant), source(dbc), "", data_of(parts)};
    if (scenario.controller.kind == ControllerKind::kRecorded) {
      texts.commands = require_part(parts, "commands", log);
      texts.commands_source = source(*texts.commands);
    }
    inputs = fit_together(
        std::move(scenario), texts,
        [&](const Scenario&, const PlantModel&, std::vector<RunPart>&) { return load_bank(); });
  } else {
    static_cast<DiagnosisInputs&>(inputs) = make_diagnosis_inputs(load_bank(), dbc, source(dbc));
  }
  inputs.parts = parts;  // all of them, under the names that the run gave them
  return inputs;
}

}  // namespace faultline

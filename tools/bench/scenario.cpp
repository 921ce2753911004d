#include "tools/bench/scenario.h"

#include <algorithm>

#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"
#include "tools/bench/endpoints.h"
#include "tools/bench/scenario_tables.h"

namespace faultline {
namespace {

/// Thirty years: microseconds since 1970 and nanoseconds of run time stay far within 64 bits.
constexpr double kMaxDuration_s = 1e9;

ChannelMapping read_mapping(TomlTable& signals, const std::string& channel) {
  ChannelMapping mapping;
  if (!signals.is_table(channel)) {
    mapping.signal = signals.string(channel);
    return mapping;
  }
  TomlTable table = signals.table(channel);
  mapping.signal = table.string("signal");
  mapping.scale = table.optional_number("scale").value_or(1.0);
  if (mapping.scale == 0.0) throw table.error("scale", "found 0, expected a non-zero factor");
  mapping.offset = table.optional_number("offset").value_or(0.0);
  if (const auto sign = table.optional_integer("sign")) {
    if (*sign != 1 && *sign != -1) {
      throw table.error("sign", fmt::format("found {}, expected 1 or -1", *sign));
    }
    mapping.scale *= static_cast<double>(*sign);
  }
  return mapping;
}

/// [[expect]], each of which must be possible beside those before it.
void read_expectations(TomlTable& root, Scenario& scenario) {
  for (const TomlTable& table : root.tables("expect")) {
    const Expectation expectation = read_expectation(table, scenario.duration_s);
    for (std::size_t i = 0; i < scenario.expectations.size(); ++i) {
      if (!contradict(scenario.expectations[i], expectation)) continue;
      throw table.error(
          "from_s", fmt::format("found {}, which contradicts entry {} ({}), expected verdicts that "
                                "one diagnosis can give where they overlap",
                                expectation_words(expectation), i + 1,
                                expectation_words(scenario.expectations[i])));
    }
    scenario.expectations.push_back(expectation);
  }
}

Scenario scenario_of(TomlTable root, const std::filesystem::path& file,
                     const IncludeReader& includes) {
  Scenario scenario;
  scenario.includes = adopt_includes(root, file, includes);
  scenario.tables = root;
  scenario.file = file;
  scenario.text = root.text();
  if (const auto schema = root.integer("schema"); schema != 1) {
    throw root.error("schema", fmt::format("found {}, expected 1", schema));
  }
  scenario.name = root.string("name");
  scenario.plant = path_in(root, "plant");
  scenario.bank = path_in(root, "bank");
  scenario.dbc = path_in(root, "dbc");
  if (const auto bus = root.optional_string("bus")) {
    if (!is_bus_name(*bus)) {
      throw root.error("bus", fmt::format("found \"{}\", expected {}", *bus, kBusNamesHelp));
    }
    scenario.bus = *bus;
  }
  scenario.duration_s = read_positive(root, "duration_s");
  if (scenario.duration_s > kMaxDuration_s) {
    throw root.error("duration_s", fmt::format("found {}, expected at most {}", scenario.duration_s,
                                               kMaxDuration_s));
  }
  scenario.seed = root.optional_integer("seed").value_or(1);
  if (root.is_table("initial_state")) {
    TomlTable states = root.table("initial_state");
    for (const std::string& name : states.keys()) {
      scenario.initial_states.emplace(name, states.number(name));
    }
  } else {
    scenario.initial_state = root.optional_vector("initial_state", -1);
  }
  scenario.is_initial_state_known = root.optional_boolean("initial_state_known").value_or(false);
  if (auto simulation = root.optional_table("simulation")) {
    scenario.simulation = read_simulation(*simulation, folder_of(*simulation, "library"));
  }
  if (auto controller = root.optional_table("controller")) {
    scenario.controller = read_controller(*controller, folder_of(*controller, "file"));
  }
  for (const TomlTable& table : root.tables("reference")) {
    scenario.controller.reference_steps.push_back(read_reference_step(table, scenario.controller));
  }
  for (const TomlTable& table : root.tables("fault")) {
    scenario.injections.push_back(read_injection(table, scenario.duration_s));
  }
  for (const TomlTable& table : root.tables("disturbance")) {
    scenario.disturbances.push_back(read_perturbation(table, folder_of(table, "target")));
  }
  for (const TomlTable& table : root.tables("noise")) {
    scenario.noises.push_back(read_perturbation(table, folder_of(table, "target")));
  }
  read_expectations(root, scenario);
  if (auto signals = root.optional_table("signals")) {
    for (const std::string& channel : signals->keys()) {
      scenario.signals.emplace(channel, read_mapping(*signals, channel));
    }
  }
  if (auto rates = root.optional_table("rates")) scenario.rates = read_rates(*rates);
  root.finish();
  return scenario;
}

}  // namespace

double read_positive(TomlTable& table, std::string_view key) {
  const double value = table.number(key);
  if (value <= 0.0) {
    throw table.error(key, fmt::format("found {}, expected a positive number", value));
  }
  return value;
}

double require_time(const TomlTable& table, std::string_view key, double value) {
  if (value < 0.0) {
    throw table.error(key, fmt::format("found {}, expected zero or more seconds", value));
  }
  return value;
}

std::filesystem::path folder_of(const TomlTable& table, std::string_view key) {
  return std::filesystem::path(table.source_of(key)).parent_path();
}

std::filesystem::path path_in(TomlTable& table, std::string_view key) {
  return folder_of(table, key) / table.string(key);
}

Scenario read_scenario(const std::filesystem::path& file) {
  return scenario_of(TomlTable::read_file(file), file, includes_beside(file));
}

Scenario parse_scenario(std::string_view text, const std::filesystem::path& file,
                        const std::vector<IncludedText>& includes) {
  return scenario_of(TomlTable::parse(text, file.string()), file,
                     includes_among(includes, file.string()));
}

InputError scenario_error(const Scenario& scenario, std::string_view table, std::string_view key,
                          const std::string& text, std::optional<std::size_t> entry) {
  const auto at = [&]() -> InputError {
    if (!scenario.tables) return {scenario.file.string(), {}, ""};
    TomlTable root = *scenario.tables;
    if (table.empty() || !root.has(table)) return root.error(key, "");
    if (entry) return root.tables(table).at(*entry).error(key, "");
    return root.table(table).error(key, "");
  }();
  return {at.source(), at.position(), text};
}

}  // namespace faultline

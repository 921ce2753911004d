#include <algorithm>

#include <fmt/format.h>

#include "tools/bench/scenario_tables.h"

namespace faultline {
namespace {

using enum IntegrationMethod;

bool is_given_by_equations(const SimulationSpec& simulation) {
  return !simulation.model.empty() || !simulation.library.empty();
}

// "model" or "library", and "parameters" of what they name.
void read_equations(TomlTable& table, const std::filesystem::path& folder,
                    SimulationSpec& simulation) {
  simulation.model = table.optional_string("model").value_or("");
  if (const auto library = table.optional_string("library")) {
    if (table.has("model")) {
      throw table.error("library", "found it beside `model`, expected one of both");
    }
    if (library->empty()) throw table.error("library", "found \"\", expected a file");
    simulation.library = folder / *library;
  }
  if (table.has("model") && simulation.model.empty()) {
    throw table.error("model", "found \"\", expected the name of a plant");
  }
  auto parameters = table.optional_table("parameters");
  if (!parameters) return;
  for (const std::string& name : parameters->keys()) {
    simulation.parameters.emplace(name, parameters->number(name));
  }
}

// [simulation.uncertainty]: what the plant really is; whether it may be, its file says.
void read_uncertainty(TomlTable& table, SimulationSpec& simulation) {
  auto values = table.optional_table("uncertainty");
  if (!values) return;
  if (is_given_by_equations(simulation)) {
    throw table.error("uncertainty",
                      "found it beside `model` or `library`, expected `parameters` there: other "
                      "values of the plant's own");
  }
  for (const std::string& name : values->keys()) {
    simulation.uncertainty.emplace(
        name, values->is_list(name) ? values->numbers(name) : std::vector{values->number(name)});
  }
}

void read_method(TomlTable& table, SimulationSpec& simulation) {
  if (is_given_by_equations(simulation) && !table.has("method")) return;
  const std::string name =
      table.choice("method", {"exact", "zoh", "euler", "rk4", "dormand_prince"});
  for (const IntegrationMethod method : {kExact, kZoh, kEuler, kRk4, kDormandPrince}) {
    if (name == integration_method_name(method)) simulation.integration.method = method;
  }
}

// Of a key that only one method has.
void require_method(const TomlTable& table, std::string_view key, IntegrationMethod found,
                    IntegrationMethod expected) {
  if (found == expected) return;
  throw table.error(key,
                    fmt::format("found it with method = \"{}\", expected it with \"{}\" only",
                                integration_method_name(found), integration_method_name(expected)));
}

void read_numbers(TomlTable& table, Integration& integration) {
  const IntegrationMethod method = integration.method.value_or(kRk4);
  if (table.has("substeps")) {
    require_method(table, "substeps", method, kRk4);
    const std::int64_t substeps = table.integer("substeps");
    if (substeps < 1 || substeps > kMostSubsteps) {
      throw table.error("substeps",
                        fmt::format("found {}, expected 1 to {}", substeps, kMostSubsteps));
    }
    integration.substeps = static_cast<int>(substeps);
  }
  if (table.has("absolute_tolerance")) {
    require_method(table, "absolute_tolerance", method, kDormandPrince);
    integration.absolute_tolerance = read_positive(table, "absolute_tolerance");
  }
  if (table.has("relative_tolerance")) {
    require_method(table, "relative_tolerance", method, kDormandPrince);
    integration.relative_tolerance = read_positive(table, "relative_tolerance");
  }
}

}  // namespace

SimulationSpec read_simulation(TomlTable table, const std::filesystem::path& folder) {
  SimulationSpec simulation;
  read_equations(table, folder, simulation);
  if (table.has("parameters") && !is_given_by_equations(simulation)) {
    throw table.error("parameters", "found it without `model` or `library`, expected one of both");
  }
  read_uncertainty(table, simulation);
  // A table for what the plant is needs no word about how it is integrated.
  if (simulation.uncertainty.empty() || table.has("method")) read_method(table, simulation);
  read_numbers(table, simulation.integration);
  return simulation;
}

}  // namespace faultline

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/model/toml_reader.h"
#include "sim/equation_plant.h"
#include "sim/model_plant.h"
#include "sim/plant_library.h"
#include "sim/plants/catalogue.h"
#include "tools/bench/bench_parts.h"

namespace faultline {
namespace {

void check_plant_can_run(const Scenario& scenario, const PlantModel& plant,
                         const NamedText& plant_file, double sample_time_s) {
  try {
    static_cast<void>(method_for(plant, scenario.simulation.integration));
  } catch (const std::invalid_argument& error) {
    throw scenario_error(scenario, "simulation", "method",
                         fmt::format("simulation.{}", error.what()));
  }
  try {
    const ModelPlant stepped(plant, sample_time_s, scenario.simulation.integration);
  } catch (const std::invalid_argument& error) {
    throw TomlTable::parse(plant_file.text, plant_file.source).error("sample_time_s", error.what());
  }
}

// The plant that is simulated: the file's, with its uncertainties where the scenario says.
PlantModel uncertain_plant(const Scenario& scenario, PlantModel plant) {
  for (const auto& [name, delta] : scenario.simulation.uncertainty) {
    const auto refuse = [&scenario, &key = name](const std::string& text) {
      return scenario_error(scenario, "simulation", "uncertainty",
                            fmt::format("simulation.uncertainty.{}: {}", key, text));
    };
    std::vector<std::string> names;
    for (const Uncertainty& uncertainty : plant.uncertainties) names.push_back(uncertainty.name);
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      const auto near = nearest_name(name, names);
      throw refuse(
          names.empty()
              ? fmt::format("expected none: plant \"{}\" has no [[uncertainty]]", plant.name)
              : fmt::format("expected an [[uncertainty]] of plant \"{}\" ({}){}", plant.name,
                            fmt::join(names, ", "),
                            near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
    }
    const Uncertainty& uncertainty =
        plant.uncertainties[static_cast<std::size_t>(found - names.begin())];
    if (delta.size() != uncertainty.delta_A.size()) {
      throw refuse(fmt::format("found {} numbers, expected {}: one per plant of the uncertainty",
                               delta.size(), uncertainty.delta_A.size()));
    }
    double sum = 0.0;
    for (const double value : delta) {
      sum += value;
      if (!(std::abs(value) <= 1.0) || (!uncertainty.is_parameter && value < 0.0)) {
        throw refuse(fmt::format("found {}, expected {}", value,
                                 uncertainty.is_parameter
                                     ? "-1 to 1: a part of the parameter's range"
                                     : "0 to 1: how much of that plant it is"));
      }
    }
    if (!uncertainty.is_parameter && sum > 1.0) {
      throw refuse(fmt::format("found shares that add up to {}, expected 1 at most", sum));
    }
    apply_uncertainty(uncertainty, delta, plant);
  }
  return plant;
}

/// The operating point with the states that the scenario names elsewhere.
Eigen::VectorXd named_initial_state(const Scenario& scenario, const PlantModel& plant) {
  Eigen::VectorXd x = plant.x_operating;
  for (const auto& [name, value] : scenario.initial_states) {
    const auto found = std::find(plant.state_names.begin(), plant.state_names.end(), name);
    if (found == plant.state_names.end()) {
      const auto near = nearest_name(name, plant.state_names);
      throw scenario_error(
          scenario, "initial_state", name,
          fmt::format("initial_state: found \"{}\", expected a state of plant \"{}\" ({}){}", name,
                      plant.name, fmt::join(plant.state_names, ", "),
                      near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
    }
    x(found - plant.state_names.begin()) = value;
  }
  return x;
}

using TablePointer = std::shared_ptr<const faultline_plant_table>;

// The plant in C++ that the scenario names; the library stays loaded as long as somebody holds it.
TablePointer open_table(const Scenario& scenario) {
  const SimulationSpec& simulation = scenario.simulation;
  const bool is_library = !simulation.library.empty();
  try {
    if (is_library) return load_plant_library(simulation.library);
    return {std::shared_ptr<void>(), &catalogue_plant(simulation.model)};
  } catch (const std::invalid_argument& error) {
    // The command line may have named the library: then the scenario has no place to point at.
    if (is_library && simulation.is_library_override) throw;
    const char* key = is_library ? "library" : "model";
    throw scenario_error(scenario, "simulation", key,
                         fmt::format("simulation.{}: {}", key, error.what()));
  }
}

PlantMaker equation_plant_maker(const Scenario& scenario, const PlantModel& plant,
                                double sample_time_s) {
  const TablePointer table = open_table(scenario);
  const Integration integration = scenario.simulation.integration;
  const PlantParameters parameters = scenario.simulation.parameters;
  PlantMaker make = [table, plant, sample_time_s, integration, parameters] {
    return std::make_unique<EquationPlant>(*table, plant, sample_time_s, integration, parameters);
  };
  try {
    static_cast<void>(make());
  } catch (const std::invalid_argument& error) {
    const bool has_table = !scenario.simulation.is_library_override;
    throw scenario_error(scenario, has_table ? "simulation" : "", has_table ? "" : "plant",
                         fmt::format("simulation.{}", error.what()));
  }
  return make;
}

}  // namespace

PlantMaker plant_maker(const Scenario& scenario, const PlantModel& plant,
                       const NamedText& plant_file, double sample_time_s) {
  const SimulationSpec& simulation = scenario.simulation;
  if (!simulation.library.empty() && !simulation.is_library_at_hand) return {};
  if (!simulation.library.empty() || !simulation.model.empty()) {
    return equation_plant_maker(scenario, plant, sample_time_s);
  }
  const PlantModel simulated = uncertain_plant(scenario, plant);
  check_plant_can_run(scenario, simulated, plant_file, sample_time_s);
  const Integration integration = scenario.simulation.integration;
  return [simulated, sample_time_s, integration] {
    return std::make_unique<ModelPlant>(simulated, sample_time_s, integration);
  };
}

Eigen::VectorXd initial_state(const Scenario& scenario, const PlantModel& plant) {
  if (!scenario.initial_state) return named_initial_state(scenario, plant);
  if (scenario.initial_state->size() != plant.n()) {
    throw scenario_error(scenario, "", "initial_state",
                         fmt::format("initial_state: found {} numbers, expected {}, one per state",
                                     scenario.initial_state->size(), plant.n()));
  }
  return *scenario.initial_state;
}

}  // namespace faultline

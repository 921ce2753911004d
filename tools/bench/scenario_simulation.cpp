#include <fmt/format.h>

#include "tools/bench/scenario_tables.h"

namespace faultline {

SimulationSpec read_simulation(TomlTable table, const std::filesystem::path& /*folder*/) {
  using enum IntegrationMethod;
  SimulationSpec simulation;
  Integration& integration = simulation.integration;
  const std::string name = table.choice("method", {"exact", "zoh", "euler", "rk4"});
  for (const IntegrationMethod method : {kExact, kZoh, kEuler, kRk4}) {
    if (name == integration_method_name(method)) integration.method = method;
  }
  if (!table.has("substeps")) return simulation;
  if (integration.method != kRk4) {
    throw table.error(
        "substeps",
        fmt::format("found it with method = \"{}\", expected it with \"rk4\" only", name));
  }
  const std::int64_t substeps = table.optional_integer("substeps").value_or(0);
  if (substeps < 1 || substeps > kMostSubsteps) {
    throw table.error("substeps",
                      fmt::format("found {}, expected 1 to {}", substeps, kMostSubsteps));
  }
  integration.substeps = static_cast<int>(substeps);
  return simulation;
}

}  // namespace faultline

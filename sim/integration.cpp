#include "sim/integration.h"

#include <stdexcept>

#include <fmt/format.h>

namespace faultline {

std::string_view integration_method_name(IntegrationMethod method) noexcept {
  switch (method) {
    case IntegrationMethod::kExact:
      return "exact";
    case IntegrationMethod::kZoh:
      return "zoh";
    case IntegrationMethod::kEuler:
      return "euler";
    case IntegrationMethod::kRk4:
      return "rk4";
    case IntegrationMethod::kDormandPrince:
      return "dormand_prince";
  }
  return "";
}

IntegrationMethod method_for(const PlantModel& plant, const Integration& integration) {
  using enum IntegrationMethod;
  if (integration.substeps < 1 || integration.substeps > kMostSubsteps) {
    throw std::invalid_argument(
        fmt::format("substeps: found {}, expected 1 to {}", integration.substeps, kMostSubsteps));
  }
  const bool is_linear = plant.nonlinearities.empty();
  const bool is_discrete = plant.time == TimeDomain::kDiscrete;
  const IntegrationMethod method =
      integration.method.value_or(is_linear || is_discrete ? kExact : kRk4);
  if (is_discrete && method != kExact) {
    throw std::invalid_argument(
        fmt::format("method: found \"{}\", expected \"exact\": plant \"{}\" is in discrete time "
                    "and steps by its own equation",
                    integration_method_name(method), plant.name));
  }
  if (!is_linear && !is_discrete && method == kExact) {
    throw std::invalid_argument(
        fmt::format("method: found \"exact\", expected \"zoh\", \"euler\" or \"rk4\": plant "
                    "\"{}\" is nonlinear and in continuous time",
                    plant.name));
  }
  return method;
}

}  // namespace faultline

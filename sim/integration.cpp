#include "sim/integration.h"

#include <stdexcept>
#include <utility>

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

namespace {

void check_numbers(const Integration& integration) {
  if (integration.substeps < 1 || integration.substeps > kMostSubsteps) {
    throw std::invalid_argument(
        fmt::format("substeps: found {}, expected 1 to {}", integration.substeps, kMostSubsteps));
  }
  for (const auto& [name, tolerance] :
       {std::pair{"absolute_tolerance", integration.absolute_tolerance},
        std::pair{"relative_tolerance", integration.relative_tolerance}}) {
    if (!(tolerance > 0.0)) {
      throw std::invalid_argument(
          fmt::format("{}: found {}, expected a positive number", name, tolerance));
    }
  }
}

}  // namespace

IntegrationMethod method_for(const PlantModel& plant, const Integration& integration) {
  using enum IntegrationMethod;
  check_numbers(integration);
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

IntegrationMethod method_for_equations(const Integration& integration) {
  using enum IntegrationMethod;
  check_numbers(integration);
  const IntegrationMethod method = integration.method.value_or(kRk4);
  if (method != kRk4 && method != kDormandPrince) {
    throw std::invalid_argument(
        fmt::format("method: found \"{}\", expected \"rk4\" or \"dormand_prince\": the plant is "
                    "given by its equations",
                    integration_method_name(method)));
  }
  return method;
}

}  // namespace faultline

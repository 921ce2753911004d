#include "diagnosis/design/requested_disturbances.h"

#include <algorithm>
#include <optional>

#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

using Treatment = BankDisturbance::Treatment;

std::vector<std::string> known_names(const PlantModel& plant) {
  std::vector<std::string> names;
  for (const Disturbance& disturbance : plant.disturbances) {
    names.push_back(disturbance.name);
  }
  for (const Uncertainty& uncertainty : plant.uncertainties) {
    if (std::find(names.begin(), names.end(), uncertainty.name) == names.end()) {
      names.push_back(uncertainty.name);
    }
  }
  return names;
}

}  // namespace

std::vector<std::size_t> disturbance_indices(const PlantModel& plant, const BankRequest& request,
                                             std::string_view key,
                                             const std::vector<std::string>& names) {
  std::vector<std::size_t> indices;
  for (const std::string& name : names) {
    const std::size_t before = indices.size();
    for (std::size_t i = 0; i < plant.disturbances.size(); ++i) {
      const Disturbance& disturbance = plant.disturbances[i];
      if (disturbance.name == name ||
          (!disturbance.uncertainty.empty() && disturbance.uncertainty == name)) {
        indices.push_back(i);
      }
    }
    if (indices.size() == before) {
      const std::optional<std::string> near = nearest_name(name, known_names(plant));
      throw request_error(
          request, key,
          fmt::format("found \"{}\", expected names of the plant's disturbances{}", name,
                      near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
    }
  }
  return indices;
}

std::vector<BankDisturbance> disturbance_treatments(const PlantModel& plant,
                                                    const BankRequest& request) {
  std::vector<BankDisturbance> treatments;
  for (const Disturbance& disturbance : plant.disturbances) {
    treatments.push_back({disturbance.name, Treatment::kNone});
  }
  const auto treat = [&](std::string_view key, const std::vector<std::string>& names,
                         Treatment treatment) {
    for (const std::string& name : names) {
      for (const std::size_t i : disturbance_indices(plant, request, key, {name})) {
        if (treatments[i].treatment != Treatment::kNone) {
          throw request_error(request, key,
                              fmt::format("found \"{}\" twice, expected it once", name));
        }
        treatments[i].treatment = treatment;
      }
    }
  };
  treat("decouple", request.decouple, Treatment::kDecoupled);
  treat("decouple_constant", request.decouple_constant, Treatment::kConstant);
  treat("eigenstructure", request.eigenstructure.weaken, Treatment::kWeakened);
  return treatments;
}

}  // namespace faultline

#include "sim/plants/catalogue.h"

#include <stdexcept>
#include <string>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/model/toml_reader.h"
#include "sim/plants/azimuth_vessel.h"
#include "sim/plants/electric_car.h"
#include "sim/plants/flexible_joint.h"
#include "sim/plants/hou2015.h"
#include "sim/plants/three_tank.h"

namespace faultline {

const std::vector<const faultline_plant_table*>& plant_catalogue() {
  static const std::vector<const faultline_plant_table*> plants{
      &plant_table<Hou2015>(), &plant_table<FlexibleJoint>(), &plant_table<ThreeTank>(),
      &plant_table<AzimuthVessel>(), &plant_table<ElectricCar>()};
  return plants;
}

const faultline_plant_table& catalogue_plant(std::string_view name) {
  std::vector<std::string> names;
  for (const faultline_plant_table* plant : plant_catalogue()) {
    if (plant->name == name) return *plant;
    names.emplace_back(plant->name);
  }
  const auto near = nearest_name(name, names);
  throw std::invalid_argument(fmt::format(
      "found \"{}\", expected a plant that ships with Faultline ({}){}", name,
      fmt::join(names, ", "), near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
}

}  // namespace faultline

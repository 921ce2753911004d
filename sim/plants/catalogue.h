#pragma once

#include <string_view>
#include <vector>

#include "sim/plant_table.h"

namespace faultline {

/// The plants in C++ that ship with Faultline.
[[nodiscard]] const std::vector<const faultline_plant_table*>& plant_catalogue();

/// The one of that name. @throws std::invalid_argument there is none (with the nearest name).
[[nodiscard]] const faultline_plant_table& catalogue_plant(std::string_view name);

}  // namespace faultline

#pragma once

#include <string>

#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A plant as the text of its file (docs/design.md, "Files"): parse_plant gives the same plant,
/// every number to the bit. @pre faults in a file's order (actuators, sensors, others), those on
/// channels with their channels' columns and size 1, as parse_plant makes them
/// @param head comment lines above it, each without its "# "
[[nodiscard]] std::string plant_text(const PlantModel& model,
                                     const std::vector<std::string>& head = {});

}  // namespace faultline

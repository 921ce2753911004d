#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Reads plant.toml (docs/design.md, "Files"). Strict.
/// @throws InputError anything wrong in the file, with line and column.
/// @throws std::system_error the file cannot be read.
[[nodiscard]] PlantModel read_plant(const std::filesystem::path& file);

/// The same from a text; `source` is the name used in messages.
[[nodiscard]] PlantModel parse_plant(std::string_view text, const std::string& source);

}  // namespace faultline

#pragma once

#include <filesystem>
#include <memory>
#include <stdexcept>

#include "sim/plant_table.h"

namespace faultline {

/// What is wrong with a plant's table or with the library that it should be in.
class PlantLibraryError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// Checks what a table says, all but its functions' values.
/// @throws PlantLibraryError another version or size; a count of zero states, inputs or outputs; a
///   null pointer where there must be none; a name that is empty or there twice; a size that is not
///   positive (states, inputs, outputs) or negative; a number that is not finite.
void check_plant_table(const faultline_plant_table& table);

/// The plant in a shared library, which stays loaded as long as anybody holds the pointer. Loading
/// runs what the library does when it is loaded.
/// @throws PlantLibraryError no file, no library, no entry point `faultline_plant_v1`, or one that
/// throws; else as
///   check_plant_table. The message begins with the library's name.
[[nodiscard]] std::shared_ptr<const faultline_plant_table> load_plant_library(
    const std::filesystem::path& library);

}  // namespace faultline

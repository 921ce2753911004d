#pragma once

#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {

/// The [[nonlinearity]] tables of a plant file (docs/design.md, "Files").
/// @param n states of the plant.
/// @throws InputError anything wrong in them, with line and column.
[[nodiscard]] std::vector<Nonlinearity> read_nonlinearities(TomlTable& root, Eigen::Index n);

}  // namespace faultline

#pragma once

#include <string>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// plant.toml of the example of Hou, Cheng, Hu, Jin 2015, section 3.
[[nodiscard]] std::string hou_plant_text();
/// bank.toml for all pairs of its faults; `normalise` and `dwell` as given.
[[nodiscard]] std::string hou_request_text(bool normalise, int dwell);

[[nodiscard]] PlantModel hou_plant();
[[nodiscard]] BankRequest hou_request(bool normalise = true, int dwell = 3);
/// The designed bank.
[[nodiscard]] Bank hou_bank(bool normalise = true, int dwell = 3);

}  // namespace faultline

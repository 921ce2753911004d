#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// Indices of the disturbances that `names` mean: of that name, or all that stand for the
/// uncertainty of that name. `key`: where the names stand, for messages.
/// @throws InputError one that the plant does not have
[[nodiscard]] std::vector<std::size_t> disturbance_indices(const PlantModel& plant,
                                                           const BankRequest& request,
                                                           std::string_view key,
                                                           const std::vector<std::string>& names);

/// How the request treats each of the plant's disturbances.
/// @throws InputError one that the plant does not have, or that is asked for twice
[[nodiscard]] std::vector<BankDisturbance> disturbance_treatments(const PlantModel& plant,
                                                                  const BankRequest& request);

}  // namespace faultline

#pragma once

#include <filesystem>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// The bank that `request` asks for, taken from the cache when the same plant and request were
/// designed before by this build of the program, else designed and put there.
/// The cache is $XDG_CACHE_HOME/faultline, or ~/.cache/faultline; a cache that cannot be written or
/// holds damaged files only costs time.
/// @throws NotSolvable not every residual exists; InputError as design_bank.
[[nodiscard]] Bank cached_design(const PlantModel& plant, const BankRequest& request);

/// Where banks are cached; empty if neither XDG_CACHE_HOME nor HOME is set.
[[nodiscard]] std::filesystem::path bank_cache_folder();

}  // namespace faultline

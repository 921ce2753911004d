#pragma once

#include <nlohmann/json_fwd.hpp>

#include "diagnosis/design/design_bank.h"

namespace faultline {

/// A design as data (`faultline design --json`). Channels bear the plant file's names; projectors
/// are in the order of its states.
[[nodiscard]] nlohmann::ordered_json design_json(const DesignResult& result);

}  // namespace faultline

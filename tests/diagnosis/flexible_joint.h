#pragma once

#include <string>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// The flexible-joint robot of examples/ma2024: as it is (continuous), and as Euler's method at
/// 0.01 s steps it.
[[nodiscard]] PlantModel flexible_joint();
[[nodiscard]] PlantModel flexible_joint_euler();

/// A bank request of method "uio" for it, sampled at 0.01 s: `uio` are the lines of [uio] and what
/// is behind them.
[[nodiscard]] BankRequest joint_request(const std::string& uio);

}  // namespace faultline

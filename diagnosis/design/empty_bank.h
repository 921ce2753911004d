#pragma once

#include <cstdint>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// The bank of a request with everything but its filters.
[[nodiscard]] Bank bank_without_filters(const PlantModel& plant, const BankRequest& request);

/// Nothing proved yet: diagnosis/certify does that, from plant and filter alone.
[[nodiscard]] FilterCertificate empty_certificate(const PlantModel& plant);

/// DecisionRule::window that a request leaves open: five time constants of the slowest filter, in
/// samples, 10 to 1000.
[[nodiscard]] std::uint32_t estimate_window(const std::vector<ResidualFilter>& filters);

}  // namespace faultline

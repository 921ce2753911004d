#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/uio/observer_filter.h"
#include "diagnosis/design/uio/observer_plant.h"
#include "diagnosis/design/uio/observer_report.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// What an observer is chosen for.
enum class ObserverPurpose {
  kDetect,    ///< its residual is y - ŷ
  kEstimate,  ///< its residuals are the sizes of the faults it carries
};

/// A chosen observer, or none, and all that was tried.
struct ObserverChoice {
  std::optional<DesignedObserver> observer;
  ObserverReport report;
};

/// Tries every way of decoupling and every alpha of `asked`; takes the best.
/// @param step told after each set of inequalities.
/// @throws InputError a disturbance that must be decoupled cannot be; a bound is missing.
[[nodiscard]] ObserverChoice choose_observer(const PlantModel& plant, const BankRequest& request,
                                             const ObserverPlant& sampled, const ObserverTask& task,
                                             const ObserverRequest& asked, ObserverPurpose purpose,
                                             const std::function<void()>& step);

/// About how often choose_observer() will call `step`; `is_searched`: multipliers of H- are.
[[nodiscard]] std::size_t attempt_count(const ObserverRequest& asked, bool is_searched);

}  // namespace faultline

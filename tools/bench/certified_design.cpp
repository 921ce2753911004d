#include "tools/bench/certified_design.h"

#include <map>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/certify/certify.h"

namespace faultline {

DesignResult designed_and_certified(const PlantModel& plant, const BankRequest& request,
                                    const DesignProgress& progress) {
  DesignResult result = design_bank(plant, request, progress);
  try {
    certify(plant, result.bank);
  } catch (const std::invalid_argument& error) {
    throw request_error(request, "plant", error.what());
  }
  return result;
}

std::vector<std::string> failure_sentences(const DesignResult& result) {
  const auto names = [&](const std::vector<std::size_t>& faults) {
    std::vector<std::string> chosen;
    for (const std::size_t fault : faults) chosen.push_back(result.bank.fault_names[fault]);
    return fmt::format("{}", fmt::join(chosen, ", "));
  };
  std::map<std::pair<FaultSet, std::string>, std::vector<std::size_t>> hidden;
  for (const DesignFailure& failure : result.failing) {
    hidden[{failure.ignores, failure.reason}].push_back(failure.fault);
  }
  std::vector<std::string> sentences;
  for (const auto& [key, faults] : hidden) {
    sentences.push_back(
        fmt::format("ignoring {{{}}} hides {}: {}", names(key.first), names(faults), key.second));
  }
  for (const ObserverReport& report : result.observers) {
    if (report.exists) continue;
    for (const ObserverTrial& trial : report.trials) {
      sentences.push_back(fmt::format(
          "{} that decouples {}{}: {}", report.name,
          trial.decoupled.empty() ? "nothing" : fmt::format("{}", fmt::join(trial.decoupled, ", ")),
          trial.alpha > 0.0 ? fmt::format(" at alpha {:g}", trial.alpha) : "", trial.reason));
    }
  }
  return sentences;
}

}  // namespace faultline

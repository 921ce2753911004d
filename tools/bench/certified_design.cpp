#include "tools/bench/certified_design.h"

#include <stdexcept>

#include "diagnosis/certify/certify.h"

namespace faultline {

DesignResult designed_and_certified(const PlantModel& plant, const BankRequest& request) {
  DesignResult result = design_bank(plant, request);
  try {
    certify(plant, result.bank);
  } catch (const std::invalid_argument& error) {
    throw request_error(request, "plant", error.what());
  }
  return result;
}

}  // namespace faultline

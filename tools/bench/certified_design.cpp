#include "tools/bench/certified_design.h"

#include "diagnosis/certify/certify.h"

namespace faultline {

DesignResult designed_and_certified(const PlantModel& plant, const BankRequest& request) {
  DesignResult result = design_bank(plant, request);
  certify(plant, result.bank);
  return result;
}

}  // namespace faultline

#include "diagnosis/certify/certify.h"

#include <stdexcept>
#include <string>

#include <fmt/format.h>

#include "diagnosis/certify/filter_proof.h"
#include "diagnosis/certify/isolability.h"
#include "diagnosis/certify/linear_thresholds.h"
#include "diagnosis/certify/observer_proof.h"

namespace faultline {
namespace {

void check_count(const char* what, std::size_t found, std::size_t expected) {
  if (found != expected) {
    throw std::invalid_argument(
        fmt::format("the bank has {} {}, expected the plant's {}", found, what, expected));
  }
}

}  // namespace

void certify(const PlantModel& plant, Bank& bank) {
  check_count("inputs", bank.input_names.size(), plant.input_names.size());
  check_count("outputs", bank.output_names.size(), plant.output_names.size());
  check_count("faults", bank.fault_names.size(), plant.faults.size());
  check_count("disturbances", bank.disturbances.size(), plant.disturbances.size());
  for (ResidualFilter& filter : bank.filters) {
    if (filter.observer) certify_observer(plant, bank, filter);
  }
  BankProof proof(plant, bank);
  if (bank.thresholds.kind == ThresholdBasis::Kind::kCertified) {
    const LinearThresholdProof thresholds(plant, bank, proof.sampled_plant());
    for (ResidualFilter& filter : bank.filters) {
      if (!filter.observer) certify_linear_thresholds(plant, thresholds, filter);
    }
  }
  for (ResidualFilter& filter : bank.filters) {
    filter.certificate = proof.prove(filter).certificate;
  }
  bank.isolability = analyse_isolability(plant, bank);
}

}  // namespace faultline

#pragma once

#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/certify/decoupling.h"
#include "diagnosis/certify/sampled_plant.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A certificate and how sharp its numbers are.
struct FilterProof {
  FilterCertificate certificate;
  /// Largest rounding error of the gains: per input, disturbance, fault (per fault size).
  std::vector<double> input_noise, disturbance_noise, fault_noise;
  /// The stored L and J, per fault and fault size: largest gain of the response they describe, and
  /// of its difference from the residual's own.
  std::vector<double> stored_gain, internal_error;
  /// Largest difference that is none, relative to the gain: in the continuous domain the state
  /// between samples is only nearly the hold's.
  double response_tolerance = 0.0;
  /// The same for what must be exact: FilterLoop::ExactResponse.
  std::vector<double> exact_error, exact_noise;
};

/// Proves the filters of one bank; what they have in common is computed once.
class BankProof {
 public:
  /// `plant` and `bank` must outlive the proof; the lists of the bank must fit the plant's.
  /// @throws std::invalid_argument as domain_model().
  BankProof(const PlantModel& plant, const Bank& bank);

  /// @throws std::invalid_argument a number of the certificate would not be finite.
  [[nodiscard]] FilterProof prove(const ResidualFilter& filter);
  /// The sampled plant, with all frequencies computed so far.
  [[nodiscard]] SampledPlant& sampled_plant() { return loop_; }

 private:
  const PlantModel& plant_;
  const Bank& bank_;
  SampledPlant loop_;
  DecouplingAnalysis decoupling_;
  double response_tolerance_;
};

}  // namespace faultline

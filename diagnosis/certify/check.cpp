#include "diagnosis/certify/check.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/certify/check_filter.h"
#include "diagnosis/certify/check_observer.h"
#include "diagnosis/certify/check_thresholds.h"
#include "diagnosis/certify/filter_proof.h"
#include "diagnosis/certify/findings.h"
#include "diagnosis/certify/isolability.h"

namespace faultline {
namespace {

std::vector<double> values(const Eigen::VectorXd& vector) { return {vector.begin(), vector.end()}; }

// Everything of the bank that is a copy from the plant. Returns whether its lists fit the plant, so
// that there is something to be recomputed.
bool check_plant(const PlantModel& plant, const Bank& bank, Findings findings) {
  findings.compare_exactly("plant", bank.plant_name, plant.name);
  findings.compare_exactly("digest of the plant", bank.plant_digest, plant_digest(plant));
  findings.compare_exactly("inputs", bank.input_names, plant.input_names);
  findings.compare_exactly("outputs", bank.output_names, plant.output_names);
  findings.compare_exactly("faults", bank.fault_names, plant.fault_names());
  std::vector<std::string> disturbances;
  for (const BankDisturbance& disturbance : bank.disturbances) {
    disturbances.push_back(disturbance.name);
  }
  std::vector<std::string> plants_disturbances;
  for (const Disturbance& disturbance : plant.disturbances) {
    plants_disturbances.push_back(disturbance.name);
  }
  findings.compare_exactly("disturbances", disturbances, plants_disturbances);
  if (std::ssize(bank.input_names) != plant.m() || std::ssize(bank.output_names) != plant.q() ||
      bank.fault_names.size() != plant.faults.size() ||
      disturbances.size() != plants_disturbances.size()) {
    return false;
  }
  for (std::size_t j = 0; j < plant.faults.size(); ++j) {
    findings.compare_exactly("size of fault " + plant.faults[j].name, bank.fault_sizes[j],
                             plant.faults[j].size);
  }
  for (const auto& [what, stored, own] :
       {std::tuple("inputs", &bank.u_operating, &plant.u_operating),
        std::tuple("outputs", &bank.y_operating, &plant.y_operating)}) {
    if (*stored != *own) {
      findings.add(fmt::format("operating point of the {}", what),
                   fmt::format("({})", fmt::join(values(*stored), ", ")),
                   fmt::format("({})", fmt::join(values(*own), ", ")));
    }
  }
  if (plant.time == TimeDomain::kDiscrete) {
    findings.compare_exactly("sample time in s", bank.sample_time_s,
                             plant.sample_time_s.value_or(0.0));
  }
  return true;
}

std::string text_of(const PlantModel& plant, const ConfusableFaults& set) {
  std::vector<std::string> names;
  for (const std::size_t j : set.faults) {
    names.push_back(plant.faults[j].name);
  }
  return set.weights.empty() ? fmt::format("{{{}}}", fmt::join(names, ", "))
                             : fmt::format("{{{}}} with weights ({:.7g})", fmt::join(names, ", "),
                                           fmt::join(set.weights, ", "));
}

bool is_same(const ConfusableFaults& a, const ConfusableFaults& b) {
  return a.faults == b.faults &&
         std::equal(a.weights.begin(), a.weights.end(), b.weights.begin(), b.weights.end(),
                    [](double x, double y) { return std::abs(x - y) <= kSameNumber; });
}

void check_isolability(const PlantModel& plant, const Bank& bank, Findings findings) {
  const IsolabilityCertificate& stored = bank.isolability;
  const IsolabilityCertificate found = analyse_isolability(plant, bank);
  const auto compare = [&](const char* claim, bool is_stored, bool is_found) {
    if (is_stored != is_found) {
      findings.add(claim, is_stored ? "yes" : "no", is_found ? "yes" : "no");
    }
  };
  compare("signatures are distinct", stored.are_signatures_distinct, found.are_signatures_distinct);
  compare("faults are strongly isolable", stored.is_strongly_isolable, found.is_strongly_isolable);
  compare("list of confusable sets is complete", stored.is_list_complete, found.is_list_complete);
  const std::size_t count = std::max(stored.confusable.size(), found.confusable.size());
  for (std::size_t i = 0; i < count; ++i) {
    const bool is_stored = i < stored.confusable.size();
    const bool is_found = i < found.confusable.size();
    if (!is_stored || !is_found || !is_same(stored.confusable[i], found.confusable[i])) {
      findings.add(fmt::format("confusable set {}", i + 1),
                   is_stored ? text_of(plant, stored.confusable[i]) : "there is none",
                   is_found ? text_of(plant, found.confusable[i]) : "there is none");
      return;  // the rest is shifted
    }
  }
}

}  // namespace

std::string sentence(const CheckFinding& finding) {
  return fmt::format("{}: {}: the bank says {}, but it is {}", finding.subject, finding.claim,
                     finding.stored, finding.recomputed);
}

CheckResult check_bank(const PlantModel& plant, const Bank& bank) {
  CheckResult result;
  Findings findings(result, "bank");
  if (!check_plant(plant, bank, findings)) {
    return result;
  }
  try {
    BankProof proof(plant, bank);
    const LinearThresholdProof thresholds(plant, bank, proof.sampled_plant());
    for (const ResidualFilter& filter : bank.filters) {
      check_observer(plant, bank, filter, result);
      if (!filter.observer && bank.thresholds.kind == ThresholdBasis::Kind::kCertified) {
        check_thresholds(thresholds, filter, result);
      }
      try {
        const FilterProof found = proof.prove(filter);
        check_filter(plant, bank, filter, found, result);
        result.certificates.push_back(found.certificate);
      } catch (const std::invalid_argument& error) {
        Findings(result, filter.name).add("certificate", "a proof", error.what());
        result.certificates.emplace_back();
      }
    }
    check_isolability(plant, bank, findings);
  } catch (const std::invalid_argument& error) {
    findings.add("certificates", "a proof", error.what());
    result.certificates.clear();
  }
  return result;
}

}  // namespace faultline

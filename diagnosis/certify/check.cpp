#include "diagnosis/certify/check.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/certify/filter_proof.h"
#include "diagnosis/certify/forgetting.h"
#include "diagnosis/certify/isolability.h"

namespace faultline {
namespace {

using Eigen::Index;

// Numbers of a certificate that agree this far are equal: other compilers and libraries round
// differently, and no filter depends on the seventh digit.
constexpr double kSame = 1e-6;
// Rounding errors of relative pivots.
constexpr double kPivotNoise = 1e-12;
// Rounding errors of margins.
constexpr double kMarginNoise = 1e-9;
// What a residual ignores may reach it with this part of the smallest gain that it must see.
constexpr double kIgnored = 0.1;
// The time a bad sample is remembered may be rounded either way when the rule is met this closely.
constexpr double kThresholdSlack = 1e-9;
// Rounding errors of spectral radii; those of dead-beat filters are nothing else.
constexpr double kRadiusNoise = 1e-9;

const char* sensitivity_name(Sensitivity sensitivity) {
  return sensitivity == Sensitivity::kNone        ? "none"
         : sensitivity == Sensitivity::kTransient ? "transient"
                                                  : "steady";
}

std::string number(double value) { return fmt::format("{:.7g}", value); }

class Findings {
 public:
  Findings(CheckResult& result, std::string subject)
      : result_(result), subject_(std::move(subject)) {}

  void add(std::string claim, std::string stored, std::string recomputed) {
    result_.findings.push_back(
        {subject_, std::move(claim), std::move(stored), std::move(recomputed)});
  }
  void compare(const std::string& claim, double stored, double recomputed, double noise) {
    const double difference = std::abs(stored - recomputed);
    if (!(difference <= kSame * std::max(std::abs(stored), std::abs(recomputed)) + noise)) {
      add(claim, number(stored), number(recomputed));
    }
  }
  void compare_exactly(const std::string& claim, double stored, double recomputed) {
    if (stored != recomputed) {
      add(claim, fmt::format("{}", stored), fmt::format("{}", recomputed));
    }
  }
  void compare_exactly(const std::string& claim, const std::string& stored,
                       const std::string& recomputed) {
    if (stored != recomputed) {
      add(claim, fmt::format("\"{}\"", stored), fmt::format("\"{}\"", recomputed));
    }
  }
  void compare_exactly(const std::string& claim, const std::vector<std::string>& stored,
                       const std::vector<std::string>& recomputed) {
    compare_exactly(claim, fmt::format("{}", fmt::join(stored, "\", \"")),
                    fmt::format("{}", fmt::join(recomputed, "\", \"")));
  }

 private:
  CheckResult& result_;
  std::string subject_;
};

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

// One filter's claims against what was recomputed.
class FilterCheck {
 public:
  FilterCheck(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter,
              CheckResult& result)
      : plant_(plant), bank_(bank), filter_(filter), findings_(result, filter.name) {}

  void run(const FilterProof& proof) {
    check_name();
    check_sensitivities(proof);
    check_forgetting();
    check_response(proof);
    check_gains(proof);
    check_rank(proof.certificate.rank);
  }

 private:
  [[nodiscard]] const std::string& fault(std::size_t j) const { return plant_.faults[j].name; }

  void check_name() {
    if (bank_.method != "geometric") {
      return;
    }
    std::vector<std::size_t> numbers;
    for (const std::size_t j : filter_.ignores) {
      numbers.push_back(j + 1);
    }
    const char* const separator = plant_.faults.size() < 10 ? "" : "_";
    findings_.compare_exactly(
        "name by the faults it ignores", filter_.name,
        numbers.empty() ? "r0" : fmt::format("r{}", fmt::join(numbers, separator)));
  }

  void check_sensitivities(const FilterProof& proof) {
    const FilterCertificate& found = proof.certificate;
    double smallest = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      if (filter_.sees[j] != Sensitivity::kNone) {
        smallest =
            std::min(smallest, filter_.sees[j] == Sensitivity::kSteady ? found.dc_gain[j]
                                                                       : found.fault_gain[j]);
      }
    }
    if (!std::isfinite(smallest)) {
      findings_.add("faults that it sees", "none", "a residual that sees none serves nothing");
      smallest = 0.0;
    }
    const double limit = kIgnored * smallest;
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      check_sensitivity(proof, j, limit);
    }
    for (std::size_t i = 0; i < found.input_gain.size(); ++i) {
      const double unit = input_unit(plant_.input_names[i]);
      check_leak("input " + plant_.input_names[i], unit * found.input_gain[i],
                 unit * proof.input_noise[i], limit);
    }
    for (std::size_t i = 0; i < found.disturbance_gain.size(); ++i) {
      if (bank_.disturbances[i].treatment != BankDisturbance::Treatment::kNone) {
        const double unit = plant_.disturbances[i].bound.value_or(1.0);
        check_leak("disturbance " + plant_.disturbances[i].name, unit * found.disturbance_gain[i],
                   unit * proof.disturbance_noise[i], limit);
      }
    }
  }

  // What counts as one of that input: the size of a fault on it, if there is any.
  [[nodiscard]] double input_unit(const std::string& input) const {
    for (const Fault& fault : plant_.faults) {
      if (fault.kind == FaultKind::kActuator && fault.name == input) {
        return fault.size;
      }
    }
    return 1.0;
  }

  void check_leak(const std::string& what, double gain, double noise, double limit) {
    if (gain > limit + noise) {
      findings_.add("it ignores " + what, fmt::format("gain at most {}", number(limit)),
                    number(gain));
    }
  }

  void check_sensitivity(const FilterProof& proof, std::size_t j, double limit) {
    const FilterCertificate& found = proof.certificate;
    const bool is_ignored =
        std::find(filter_.ignores.begin(), filter_.ignores.end(), j) != filter_.ignores.end();
    const Sensitivity sees = filter_.sees[j];
    if (is_ignored && sees != Sensitivity::kNone) {
      findings_.add("how it sees " + fault(j), sensitivity_name(sees), "it ignores that fault");
      return;
    }
    if (sees == Sensitivity::kNone) {
      check_leak("fault " + fault(j), found.fault_gain[j], proof.fault_noise[j], limit);
      return;
    }
    const double gain = sees == Sensitivity::kSteady ? found.dc_gain[j] : found.fault_gain[j];
    if (gain <= proof.fault_noise[j]) {
      findings_.add("how it sees " + fault(j), sensitivity_name(sees),
                    fmt::format("gain {} at DC, at most {} anywhere", number(found.dc_gain[j]),
                                number(found.fault_gain[j])));
    } else if (sees == Sensitivity::kTransient && found.dc_gain[j] > limit) {
      findings_.add("how it sees " + fault(j), sensitivity_name(sees),
                    fmt::format("steady, with gain {} at DC", number(found.dc_gain[j])));
    }
  }

  void check_forgetting() {
    // A larger threshold is forgotten sooner.
    const std::uint32_t at_least = samples_to_forget(plant_, filter_, 1.0 + kThresholdSlack);
    const std::uint32_t at_most = samples_to_forget(plant_, filter_, 1.0 - kThresholdSlack);
    if (filter_.forget_samples < at_least || filter_.forget_samples > at_most) {
      findings_.add("samples that a bad sample contaminates it for",
                    fmt::format("{}", filter_.forget_samples), fmt::format("{}", at_least));
    }
  }

  void check_response(const FilterProof& proof) {
    // Relative to the largest gain: of a fault that it ignores the rest is all there is.
    double gain = 0.0;
    for (const double fault_gain : proof.certificate.fault_gain) {
      gain = std::max(gain, fault_gain);
    }
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      const double allowed = proof.response_tolerance * gain + proof.fault_noise[j];
      if (proof.exact_error[j] > proof.exact_noise[j]) {
        findings_.add(fmt::format("L and J as response to {}", fault(j)),
                      bank_.domain == DesignDomain::kSampled ? "the first two samples"
                                                             : "the first sample and DC",
                      fmt::format("others, by {}", number(proof.exact_error[j])));
      } else if (proof.internal_error[j] > allowed) {
        findings_.add(
            fmt::format("L and J as response to {}", fault(j)),
            fmt::format("gain {}", number(proof.stored_gain[j])),
            fmt::format("gain {}, apart by up to {}", number(proof.certificate.fault_gain[j]),
                        number(proof.internal_error[j])));
      }
    }
  }

  void check_gains(const FilterProof& proof) {
    const FilterCertificate& stored = filter_.certificate;
    const FilterCertificate& found = proof.certificate;
    findings_.compare("spectral radius", stored.spectral_radius, found.spectral_radius,
                      kRadiusNoise);
    findings_.compare("bandwidth in Hz", stored.band_Hz, found.band_Hz, 0.0);
    for (std::size_t i = 0; i < found.input_gain.size(); ++i) {
      findings_.compare("gain from input " + plant_.input_names[i], stored.input_gain[i],
                        found.input_gain[i], proof.input_noise[i]);
    }
    for (std::size_t i = 0; i < found.disturbance_gain.size(); ++i) {
      findings_.compare("gain from disturbance " + plant_.disturbances[i].name,
                        stored.disturbance_gain[i], found.disturbance_gain[i],
                        proof.disturbance_noise[i]);
    }
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      const double noise = proof.fault_noise[j];
      findings_.compare("largest gain of " + fault(j), stored.fault_gain[j], found.fault_gain[j],
                        noise);
      findings_.compare(fmt::format("gain of {} at DC", fault(j)), stored.dc_gain[j],
                        found.dc_gain[j], noise);
      findings_.compare(fmt::format("smallest gain of {} in the band", fault(j)),
                        stored.band_gain[j], found.band_gain[j], noise);
      findings_.compare("margin of " + fault(j), stored.margin[j], found.margin[j], kMarginNoise);
      // As sharp as the gain it comes from.
      const double gain = std::max(found.dc_gain[j], found.fault_gain[j]);
      const double slack = gain > 0.0 ? found.smallest_fault[j] * noise / gain : 0.0;
      findings_.compare("smallest fault seen of " + fault(j), stored.smallest_fault[j],
                        found.smallest_fault[j], slack);
      findings_.compare(fmt::format("delay of {} in s", fault(j)), stored.delay_s[j],
                        found.delay_s[j], 0.0);
    }
  }

  void check_rank(const RankCertificate& found) {
    const RankCertificate& stored = filter_.certificate.rank;
    findings_.compare_exactly("dim W*", stored.dim_w, found.dim_w);
    findings_.compare_exactly("dim S*", stored.dim_s, found.dim_s);
    findings_.compare("smallest pivot kept", stored.smallest_kept, found.smallest_kept,
                      kPivotNoise);
    findings_.compare("largest pivot dropped", stored.largest_dropped, found.largest_dropped,
                      kPivotNoise);
    findings_.compare("smallest tolerance with these dimensions", stored.tolerance_min,
                      found.tolerance_min, 0.0);
    findings_.compare("largest tolerance with these dimensions", stored.tolerance_max,
                      found.tolerance_max, 0.0);
  }

  const PlantModel& plant_;
  const Bank& bank_;
  const ResidualFilter& filter_;
  Findings findings_;
};

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
                    [](double x, double y) { return std::abs(x - y) <= kSame; });
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
    for (const ResidualFilter& filter : bank.filters) {
      try {
        const FilterProof found = proof.prove(filter);
        FilterCheck(plant, bank, filter, result).run(found);
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

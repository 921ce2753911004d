#include "diagnosis/certify/check_filter.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/certify/findings.h"
#include "diagnosis/certify/forgetting.h"
#include "diagnosis/certify/linear_thresholds.h"

namespace faultline {
namespace {

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

// One filter's claims against what was recomputed.
class FilterCheck {
 public:
  FilterCheck(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter,
              CheckResult& result)
      : plant_(plant), bank_(bank), filter_(filter), findings_(result, filter.name) {}

  void run(const FilterProof& proof) {
    check_name();
    check_sensitivities(proof);
    if (!filter_.observer) {
      check_forgetting();
    }
    check_response(proof);
    check_gains(proof);
    check_rank(proof.certificate.rank);
  }

 private:
  [[nodiscard]] const std::string& fault(std::size_t j) const { return plant_.faults[j].name; }

  void check_name() {
    if (bank_.method == "uio") {
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
      if (bank_.disturbances[i].is_ignored()) {
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
      findings_.add("it ignores " + what, fmt::format("gain at most {}", number_text(limit)),
                    number_text(gain));
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
                    fmt::format("gain {} at DC, at most {} anywhere", number_text(found.dc_gain[j]),
                                number_text(found.fault_gain[j])));
    } else if (sees == Sensitivity::kTransient && found.dc_gain[j] > limit) {
      findings_.add("how it sees " + fault(j), sensitivity_name(sees),
                    fmt::format("steady, with gain {} at DC", number_text(found.dc_gain[j])));
    }
  }

  void check_forgetting() {
    // A larger threshold is forgotten sooner.
    const auto samples = bank_.thresholds.kind == ThresholdBasis::Kind::kCertified
                             ? &certified_forget_samples
                             : &samples_to_forget;
    const std::uint32_t at_least = samples(plant_, filter_, 1.0 + kThresholdSlack);
    const std::uint32_t at_most = samples(plant_, filter_, 1.0 - kThresholdSlack);
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
        findings_.add(
            fmt::format("L and J as response to {}", fault(j)),
            is_sampled(bank_.domain) ? "the first two samples" : "the first sample and DC",
            fmt::format("others, by {}", number_text(proof.exact_error[j])));
      } else if (proof.internal_error[j] > allowed) {
        findings_.add(
            fmt::format("L and J as response to {}", fault(j)),
            fmt::format("gain {}", number_text(proof.stored_gain[j])),
            fmt::format("gain {}, apart by up to {}", number_text(proof.certificate.fault_gain[j]),
                        number_text(proof.internal_error[j])));
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

}  // namespace

void check_filter(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter,
                  const FilterProof& proof, CheckResult& result) {
  FilterCheck(plant, bank, filter, result).run(proof);
}

}  // namespace faultline

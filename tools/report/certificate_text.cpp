#include "tools/report/certificate_text.h"

#include <algorithm>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

std::string size_text(const Bank& bank, const ResidualFilter& filter, std::size_t fault) {
  const FilterCertificate& certificate = filter.certificate;
  const bool is_transient = filter.sees[fault] == Sensitivity::kTransient;
  std::string text = bank.fault_names[fault];
  if (certificate.smallest_fault[fault] > 0.0) {
    text += fmt::format(" from {:.3g}", certificate.smallest_fault[fault]);
  }
  if (certificate.delay_s[fault] > 0.0) {
    text += fmt::format(", {:.2g} s after twice that", certificate.delay_s[fault]);
  }
  return text + (is_transient ? " (only while it changes)" : "");
}

// Where its threshold comes from; empty: a number that was given.
std::string threshold_text(const Bank& bank, const ResidualFilter& filter) {
  std::string text;
  if (filter.test) {
    const bool is_cusum = filter.test->kind == TestKind::kCusum;
    text += fmt::format(" It is white, and evaluated by a {} test (h = {:.3g}).",
                        is_cusum ? "CUSUM" : "GLR", filter.threshold);
  }
  if (filter.calibration) {
    const Calibration& c = *filter.calibration;
    text += fmt::format(
        " Its threshold is calibrated from {:.3g} h without a fault: {:.2g} false alarms an hour, "
        "with 95 % confidence {:.2g} to {:.2g}.",
        c.hours, c.false_alarms_per_h, c.rate_low_per_h, c.rate_high_per_h);
  } else if (filter.shares && bank.thresholds.false_alarms_per_h > 0.0) {
    text += fmt::format(
        " Its threshold is certified: {:.2g} false alarms an hour by noise in all residuals "
        "together, none by what is bounded.",
        bank.thresholds.false_alarms_per_h);
  } else if (filter.shares) {
    text += " Its threshold is certified: nothing within the plant file's bounds crosses it.";
  }
  return text;
}

}  // namespace

std::string names_in_words(const std::vector<std::string>& names) {
  if (names.empty()) return "nothing";
  if (names.size() == 1) return names.front();
  return fmt::format("{} and {}", fmt::join(names.begin(), names.end() - 1, ", "), names.back());
}

std::string certificate_text(const Bank& bank, const ResidualFilter& filter) {
  const FilterCertificate& certificate = filter.certificate;
  std::vector<std::string> ignored, seen;
  double leakage = 0.0;
  for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
    if (filter.sees[j] == Sensitivity::kNone) {
      ignored.push_back(bank.fault_names[j]);
      leakage = std::max(leakage, certificate.fault_gain[j]);
    } else {
      seen.push_back(size_text(bank, filter, j));
    }
  }
  std::string text = fmt::format("{} ignores {}", filter.name, names_in_words(ignored));
  if (!ignored.empty()) text += fmt::format(": leakage {:.0e}", leakage);
  text += fmt::format(". It sees {}.", fmt::join(seen, "; "));
  const auto& inputs = certificate.input_gain;
  if (!inputs.empty()) {
    text += fmt::format(" Largest gain from an input {:.0e}.",
                        *std::max_element(inputs.begin(), inputs.end()));
  }
  for (std::size_t i = 0; i < bank.disturbances.size(); ++i) {
    const BankDisturbance& disturbance = bank.disturbances[i];
    const char* const how = disturbance.treatment == BankDisturbance::Treatment::kNone
                                ? "reaches it with a gain of at most"
                            : disturbance.treatment == BankDisturbance::Treatment::kConstant
                                ? "is decoupled while constant: leakage"
                                : "is decoupled: leakage";
    text += fmt::format(" Disturbance {} {} {:.0e}.", disturbance.name, how,
                        certificate.disturbance_gain[i]);
  }
  return text + threshold_text(bank, filter) +
         fmt::format(" Spectral radius {:.4f}; the same ranks for tolerances {:.0e} to {:.0e}.",
                     certificate.spectral_radius, certificate.rank.tolerance_min,
                     certificate.rank.tolerance_max);
}

}  // namespace faultline

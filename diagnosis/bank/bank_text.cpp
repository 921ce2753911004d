#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/bank/json_text.h"
#include "diagnosis/bank/json_tree.h"
#include "diagnosis/bank/observer_text.h"

namespace faultline {
namespace {

std::vector<std::string> sensitivity_names(const std::vector<Sensitivity>& sees) {
  std::vector<std::string> names;
  for (const Sensitivity sensitivity : sees) {
    names.emplace_back(sensitivity == Sensitivity::kNone        ? "none"
                       : sensitivity == Sensitivity::kTransient ? "transient"
                                                                : "steady");
  }
  return names;
}

std::string disturbances_text(const std::vector<BankDisturbance>& disturbances) {
  using Treatment = BankDisturbance::Treatment;
  std::vector<std::string> items;
  for (const BankDisturbance& disturbance : disturbances) {
    items.push_back(fmt::format("{{\"name\": {}, \"treatment\": \"{}\"}}",
                                json_string(disturbance.name),
                                disturbance.treatment == Treatment::kNone        ? "none"
                                : disturbance.treatment == Treatment::kDecoupled ? "decoupled"
                                : disturbance.treatment == Treatment::kConstant  ? "constant"
                                                                                 : "weakened"));
  }
  return fmt::format("[{}]", fmt::join(items, ", "));
}

std::string isolability_text(const Bank& bank) {
  const IsolabilityCertificate& isolability = bank.isolability;
  std::vector<std::string> sets;
  for (const ConfusableFaults& set : isolability.confusable) {
    sets.push_back(fmt::format("{{\"faults\": {}, \"weights\": {}}}",
                               name_list(names_of(bank.fault_names, set.faults)),
                               number_list(set.weights)));
  }
  return fmt::format(
      "{{\"signatures_distinct\": {}, \"strongly_isolable\": {}, \"list_complete\": {}, "
      "\"confusable\": [{}]}}",
      isolability.are_signatures_distinct, isolability.is_strongly_isolable,
      isolability.is_list_complete, fmt::join(sets, ", "));
}

std::string rank_text(const RankCertificate& rank) {
  return fmt::format(
      "{{\"dim_w\": {}, \"dim_s\": {}, \"smallest_kept\": {}, \"largest_dropped\": {}, "
      "\"tolerance_min\": {}, \"tolerance_max\": {}}}",
      rank.dim_w, rank.dim_s, json_number(rank.smallest_kept), json_number(rank.largest_dropped),
      json_number(rank.tolerance_min), json_number(rank.tolerance_max));
}

std::string certificate_text(const FilterCertificate& certificate) {
  std::string text = "{\n";
  const auto add = [&](std::string_view key, const std::string& value) {
    text += fmt::format("        \"{}\": {},\n", key, value);
  };
  add("spectral_radius", json_number(certificate.spectral_radius));
  add("input_gain", number_list(certificate.input_gain));
  add("disturbance_gain", number_list(certificate.disturbance_gain));
  add("fault_gain", number_list(certificate.fault_gain));
  add("dc_gain", number_list(certificate.dc_gain));
  add("band_gain", number_list(certificate.band_gain));
  add("band_Hz", json_number(certificate.band_Hz));
  add("margin", number_list(certificate.margin));
  add("smallest_fault", number_list(certificate.smallest_fault));
  add("delay_s", number_list(certificate.delay_s));
  text += fmt::format("        \"rank\": {}\n      }}", rank_text(certificate.rank));
  return text;
}

std::string thresholds_text(const ThresholdBasis& basis) {
  using Kind = ThresholdBasis::Kind;
  return fmt::format(
      "{{\"kind\": \"{}\", \"output_resolution\": {}, \"jitter_s\": {}, "
      "\"false_alarms_per_h\": {}}}",
      basis.kind == Kind::kGiven       ? "given"
      : basis.kind == Kind::kCertified ? "certified"
                                       : "calibrated",
      number_list(basis.output_resolution), json_number(basis.jitter_s),
      json_number(basis.false_alarms_per_h));
}

std::string test_text(const SequentialTest& test) {
  return fmt::format("{{\"kind\": \"{}\", \"reference\": {}, \"window\": {}, \"offset\": {}}}",
                     test.kind == TestKind::kCusum ? "cusum" : "glr", json_number(test.reference),
                     test.window, number_list(test.offset));
}

std::string shares_text(const ThresholdShares& shares) {
  return fmt::format(
      "{{\"disturbance\": {}, \"noise\": {}, \"resolution\": {}, \"leakage\": {}, \"jitter\": {}, "
      "\"gaussian\": {}}}",
      number_list(shares.disturbance), number_list(shares.noise), number_list(shares.resolution),
      number_list(shares.leakage), number_list(shares.jitter), number_list(shares.gaussian));
}

std::string calibration_text(const Calibration& calibration) {
  return fmt::format(
      "{{\"hours\": {}, \"exceedances\": {}, \"level\": {}, \"scale\": {}, \"shape\": {}, "
      "\"false_alarms_per_h\": {}, \"rate_low_per_h\": {}, \"rate_high_per_h\": {}, "
      "\"held_out_hours\": {}, \"held_out_expected\": {}, \"held_out_found\": {}}}",
      json_number(calibration.hours), calibration.exceedances, json_number(calibration.level),
      json_number(calibration.scale), json_number(calibration.shape),
      json_number(calibration.false_alarms_per_h), json_number(calibration.rate_low_per_h),
      json_number(calibration.rate_high_per_h), json_number(calibration.held_out_hours),
      json_number(calibration.held_out_expected), calibration.held_out_found);
}

std::string filter_text(const Bank& bank, const ResidualFilter& filter) {
  // Column of a matrix's second row: under its first.
  constexpr int kRowIndent = 12;
  std::string text = "    {\n";
  text += fmt::format("      \"name\": {},\n", json_string(filter.name));
  text += fmt::format("      \"ignores\": {},\n",
                      name_list(names_of(bank.fault_names, filter.ignores)));
  text += fmt::format("      \"sees\": {},\n", name_list(sensitivity_names(filter.sees)));
  for (const auto& [letter, matrix] :
       {std::pair{'F', &filter.F}, std::pair{'E', &filter.E}, std::pair{'G', &filter.G},
        std::pair{'M', &filter.M}, std::pair{'H', &filter.H}, std::pair{'K', &filter.K},
        std::pair{'L', &filter.L}, std::pair{'J', &filter.J}}) {
    text += fmt::format("      \"{}\": {},\n", letter, matrix_text(*matrix, kRowIndent));
  }
  text += fmt::format("      \"threshold\": {},\n", json_number(filter.threshold));
  text += fmt::format("      \"forget_samples\": {},\n", filter.forget_samples);
  if (is_observer(filter)) {
    text += fmt::format("      \"observer\": {},\n", observer_text(bank, filter));
  }
  if (filter.test) text += fmt::format("      \"test\": {},\n", test_text(*filter.test));
  if (filter.shares) text += fmt::format("      \"shares\": {},\n", shares_text(*filter.shares));
  if (filter.calibration) {
    text += fmt::format("      \"calibration\": {},\n", calibration_text(*filter.calibration));
  }
  text += fmt::format("      \"certificate\": {}\n    }}", certificate_text(filter.certificate));
  return text;
}

}  // namespace

std::string bank_text(const Bank& bank) {
  std::vector<std::string> filters;
  for (const ResidualFilter& filter : bank.filters) {
    filters.push_back(filter_text(bank, filter));
  }
  std::string text = "{\n  \"schema\": 1,\n";
  text += fmt::format("  \"name\": {},\n", json_string(bank.name));
  text += fmt::format("  \"method\": {},\n", json_string(bank.method));
  text += fmt::format("  \"plant\": {{\"name\": {}, \"digest\": {}}},\n",
                      json_string(bank.plant_name), json_string(bank.plant_digest));
  text += fmt::format("  \"request_digest\": {},\n", json_string(bank.request_digest));
  text += fmt::format("  \"domain\": \"{}\",\n", domain_name(bank.domain));
  text += fmt::format("  \"sample_time_s\": {},\n", json_number(bank.sample_time_s));
  text += fmt::format("  \"concurrent\": {},\n", bank.concurrent);
  text += fmt::format("  \"inputs\": {},\n", name_list(bank.input_names));
  text += fmt::format("  \"outputs\": {},\n", name_list(bank.output_names));
  text += fmt::format("  \"faults\": {},\n", name_list(bank.fault_names));
  text += fmt::format("  \"fault_sizes\": {},\n", number_list(bank.fault_sizes));
  text += fmt::format("  \"operating_point\": {{\"u\": {}, \"y\": {}}},\n",
                      number_list(bank.u_operating), number_list(bank.y_operating));
  text += fmt::format("  \"disturbances\": {},\n", disturbances_text(bank.disturbances));
  text += fmt::format(
      "  \"decision\": {{\"dwell\": {}, \"settle\": {}, \"window\": {}{}}},\n", bank.decision.dwell,
      bank.decision.settle, bank.decision.window,
      bank.decision.clearing == 0 ? "" : fmt::format(", \"clearing\": {}", bank.decision.clearing));
  if (bank.thresholds.kind != ThresholdBasis::Kind::kGiven ||
      bank.thresholds.output_resolution.size() > 0) {
    text += fmt::format("  \"thresholds\": {},\n", thresholds_text(bank.thresholds));
  }
  text += fmt::format("  \"isolability\": {},\n", isolability_text(bank));
  text += fmt::format("  \"filters\": [\n{}\n  ]\n}}\n", fmt::join(filters, ",\n"));
  return text;
}

}  // namespace faultline

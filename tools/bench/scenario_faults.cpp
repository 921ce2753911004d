#include <fmt/format.h>

#include "tools/bench/scenario_tables.h"

namespace faultline {

namespace {

template <class Timed>
void read_end(TomlTable& table, Timed& entry) {
  entry.until_s = table.optional_number("until_s");
  if (entry.until_s && *entry.until_s <= entry.at_s) {
    throw table.error("until_s", fmt::format("found {}, expected more than at_s = {}",
                                             *entry.until_s, entry.at_s));
  }
}

template <class Sinusoid>
void read_sinusoid(TomlTable& table, Sinusoid& entry) {
  entry.frequency_Hz = read_positive(table, "frequency_Hz");
  entry.phase_rad = table.optional_number("phase_rad").value_or(0.0);
}

}  // namespace

Injection read_injection(TomlTable table) {
  Injection injection;
  injection.target = table.string("target");
  const std::string kind = table.choice("kind", {"bias", "gain", "sinusoid"});
  if (kind == "gain") injection.kind = InjectionKind::kGain;
  if (kind == "sinusoid") {
    injection.kind = InjectionKind::kSinusoid;
    read_sinusoid(table, injection);
  }
  injection.value = table.number("value");
  injection.at_s = require_time(table, "at_s", table.number("at_s"));
  read_end(table, injection);
  injection.ramp_s = require_time(table, "ramp_s", table.optional_number("ramp_s").value_or(0.0));
  if (table.has("period_s")) injection.period_s = read_positive(table, "period_s");
  return injection;
}

Perturbation read_perturbation(TomlTable table, const std::filesystem::path& /*folder*/) {
  Perturbation perturbation;
  perturbation.target = table.string("target");
  const std::string kind = table.choice("kind", {"uniform", "constant", "sinusoid"});
  if (kind == "constant") perturbation.kind = PerturbationKind::kConstant;
  if (kind == "sinusoid") {
    perturbation.kind = PerturbationKind::kSinusoid;
    read_sinusoid(table, perturbation);
  }
  // A constant may have either sign; of the others the sign says nothing.
  if (perturbation.kind == PerturbationKind::kConstant) {
    perturbation.size = table.optional_number("size");
  } else if (table.has("size")) {
    perturbation.size = read_positive(table, "size");
  }
  perturbation.at_s = require_time(table, "at_s", table.optional_number("at_s").value_or(0.0));
  read_end(table, perturbation);
  return perturbation;
}

}  // namespace faultline

#include <string>
#include <vector>

#include <fmt/format.h>

#include "sim/injection_rule.h"
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

void read_band(TomlTable& table, Perturbation& perturbation) {
  perturbation.from_Hz = table.number("from_Hz");
  perturbation.to_Hz = table.number("to_Hz");
  if (perturbation.from_Hz < 0.0) {
    throw table.error("from_Hz",
                      fmt::format("found {}, expected zero or more", perturbation.from_Hz));
  }
  if (perturbation.to_Hz <= perturbation.from_Hz) {
    throw table.error("to_Hz", fmt::format("found {}, expected more than from_Hz = {}",
                                           perturbation.to_Hz, perturbation.from_Hz));
  }
}

void read_record(TomlTable& table, const std::filesystem::path& folder,
                 Perturbation& perturbation) {
  perturbation.file = folder / table.string("file");
  perturbation.column = table.optional_string("column").value_or("");
  perturbation.is_repeated = table.optional_boolean("repeat").value_or(false);
  if (table.has("between") && table.choice("between", {"linear", "hold"}) == "hold") {
    perturbation.between = RecordedSignal::Between::kHold;
  }
}

InjectionKind read_injection_kind(TomlTable& table) {
  const std::string name = table.string("kind");
  if (const auto kind = find_injection_kind(name)) return *kind;
  std::vector<std::string> names;
  for (const InjectionKind kind : all_injection_kinds()) {
    names.emplace_back(injection_kind_name(kind));
  }
  const auto near = nearest_name(name, names);
  throw table.error("kind",
                    fmt::format("found \"{}\", expected one of {}{}", name, fmt::join(names, ", "),
                                near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
}

/// Keys that other kinds have, but not this one.
void refuse_foreign_keys(const TomlTable& table, InjectionKind kind) {
  for (const char* key : {"value", "ramp_s", "frequency_Hz", "phase_rad", "with"}) {
    if (!table.has(key) || takes_key(kind, key)) continue;
    throw table.error(key, fmt::format("found it with kind = \"{}\", which does not use it",
                                       injection_kind_name(kind)));
  }
}

}  // namespace

Injection read_injection(TomlTable table, double duration_s) {
  Injection injection;
  injection.target = table.string("target");
  injection.kind = read_injection_kind(table);
  refuse_foreign_keys(table, injection.kind);
  injection.value = table.optional_number("value");
  injection.at_s = table.number("at_s");
  injection.until_s = table.optional_number("until_s");
  injection.ramp_s = table.optional_number("ramp_s").value_or(0.0);
  injection.period_s = table.optional_number("period_s");
  injection.spread_s = table.optional_number("spread_s").value_or(0.0);
  injection.probability = table.optional_number("probability").value_or(1.0);
  if (injection.kind == InjectionKind::kSinusoid) read_sinusoid(table, injection);
  if (injection.kind == InjectionKind::kSwapped) injection.with = table.string("with");
  if (const auto mistake = find_mistake(injection)) {
    throw table.error(mistake->field, mistake->text);
  }
  if (injection.at_s + injection.spread_s > duration_s) {
    throw table.error(
        "at_s",
        fmt::format(
            "found {}{}, expected at most duration_s = {}", injection.at_s,
            injection.spread_s > 0.0 ? fmt::format(" and spread_s = {}", injection.spread_s) : "",
            duration_s));
  }
  return injection;
}

Perturbation read_perturbation(TomlTable table, const std::filesystem::path& folder) {
  using enum PerturbationKind;
  Perturbation perturbation;
  perturbation.target = table.string("target");
  const std::string kind = table.choice(
      "kind", {"uniform", "constant", "sinusoid", "gaussian", "band_limited", "recorded"});
  for (const PerturbationKind one :
       {kUniform, kConstant, kSinusoid, kGaussian, kBandLimited, kRecorded}) {
    if (kind == perturbation_kind_name(one)) perturbation.kind = one;
  }
  if (perturbation.kind == kSinusoid) read_sinusoid(table, perturbation);
  if (perturbation.kind == kGaussian || perturbation.kind == kBandLimited) {
    if (table.has("sigma")) perturbation.sigma = read_positive(table, "sigma");
    if (perturbation.kind == kBandLimited) read_band(table, perturbation);
  } else if (perturbation.kind == kConstant || perturbation.kind == kRecorded) {
    // These may have either sign; of the others the sign says nothing.
    perturbation.size = table.optional_number("size");
  } else if (table.has("size")) {
    perturbation.size = read_positive(table, "size");
  }
  if (perturbation.kind == kRecorded) read_record(table, folder, perturbation);
  perturbation.at_s = require_time(table, "at_s", table.optional_number("at_s").value_or(0.0));
  read_end(table, perturbation);
  return perturbation;
}

}  // namespace faultline

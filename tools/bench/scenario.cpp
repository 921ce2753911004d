#include "tools/bench/scenario.h"

#include <algorithm>

#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"
#include "tools/bench/endpoints.h"

namespace faultline {
namespace {

/// Thirty years: microseconds since 1970 and nanoseconds of run time stay far within 64 bits.
constexpr double kMaxDuration_s = 1e9;

double positive(TomlTable& table, std::string_view key) {
  const double value = table.number(key);
  if (value <= 0.0) {
    throw table.error(key, fmt::format("found {}, expected a positive number", value));
  }
  return value;
}

double not_negative(const TomlTable& table, std::string_view key, double value) {
  if (value < 0.0) {
    throw table.error(key, fmt::format("found {}, expected zero or more seconds", value));
  }
  return value;
}

ControllerSpec read_controller(TomlTable table) {
  ControllerSpec spec;
  const std::string kind = table.choice("kind", {"lqr", "gain", "none"});
  if (kind == "lqr") {
    spec.kind = ControllerKind::kLqr;
    spec.Q = table.optional_matrix("Q", -1, -1);
    spec.R = table.optional_matrix("R", -1, -1);
  } else if (kind == "gain") {
    spec.kind = ControllerKind::kGain;
    spec.K = table.matrix("K", -1, -1);
  }
  spec.feedforward = table.optional_vector("feedforward", -1);
  spec.amplitude = table.optional_vector("amplitude", -1);
  if (spec.amplitude) spec.frequency_Hz = table.vector("frequency_Hz", spec.amplitude->size());
  return spec;
}

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
  entry.frequency_Hz = positive(table, "frequency_Hz");
  entry.phase_rad = table.optional_number("phase_rad").value_or(0.0);
}

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
  injection.at_s = not_negative(table, "at_s", table.number("at_s"));
  read_end(table, injection);
  injection.ramp_s = not_negative(table, "ramp_s", table.optional_number("ramp_s").value_or(0.0));
  if (table.has("period_s")) injection.period_s = positive(table, "period_s");
  return injection;
}

Perturbation read_perturbation(TomlTable table) {
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
    perturbation.size = positive(table, "size");
  }
  perturbation.at_s = not_negative(table, "at_s", table.optional_number("at_s").value_or(0.0));
  read_end(table, perturbation);
  return perturbation;
}

Integration read_simulation(TomlTable table) {
  using enum IntegrationMethod;
  Integration integration;
  const std::string name = table.choice("method", {"exact", "zoh", "euler", "rk4"});
  for (const IntegrationMethod method : {kExact, kZoh, kEuler, kRk4}) {
    if (name == integration_method_name(method)) integration.method = method;
  }
  if (!table.has("substeps")) return integration;
  if (integration.method != kRk4) {
    throw table.error(
        "substeps",
        fmt::format("found it with method = \"{}\", expected it with \"rk4\" only", name));
  }
  const std::int64_t substeps = table.optional_integer("substeps").value_or(0);
  if (substeps < 1 || substeps > kMostSubsteps) {
    throw table.error("substeps",
                      fmt::format("found {}, expected 1 to {}", substeps, kMostSubsteps));
  }
  integration.substeps = static_cast<int>(substeps);
  return integration;
}

Expectation read_expectation(TomlTable table, double duration_s) {
  Expectation expectation;
  expectation.from_s = not_negative(table, "from_s", table.number("from_s"));
  expectation.until_s = table.number("until_s");
  if (expectation.until_s < expectation.from_s) {
    throw table.error("until_s", fmt::format("found {}, expected at least from_s = {}",
                                             expectation.until_s, expectation.from_s));
  }
  if (expectation.from_s > duration_s) {
    throw table.error("from_s", fmt::format("found {}, expected at most duration_s = {}",
                                            expectation.from_s, duration_s));
  }
  const std::string verdict =
      table.choice("verdict", {"healthy", "isolated", "ambiguous", "unexplained", "inhibited"});
  for (const Verdict candidate : {Verdict::kHealthy, Verdict::kIsolated, Verdict::kAmbiguous,
                                  Verdict::kUnexplained, Verdict::kInhibited}) {
    if (verdict == verdict_name(candidate)) expectation.verdict = candidate;
  }
  if (expectation.verdict == Verdict::kIsolated) {
    expectation.faults = table.strings("faults");
    if (expectation.faults.empty()) {
      throw table.error("faults", "found an empty list, expected the isolated faults");
    }
    std::sort(expectation.faults.begin(), expectation.faults.end());
  } else if (table.has("faults")) {
    throw table.error("faults", fmt::format("found a list, expected none: only the verdict "
                                            "\"isolated\" names faults, this one is \"{}\"",
                                            verdict));
  }
  return expectation;
}

ChannelMapping read_mapping(TomlTable& signals, const std::string& channel) {
  ChannelMapping mapping;
  if (!signals.is_table(channel)) {
    mapping.signal = signals.string(channel);
    return mapping;
  }
  TomlTable table = signals.table(channel);
  mapping.signal = table.string("signal");
  mapping.scale = table.optional_number("scale").value_or(1.0);
  if (mapping.scale == 0.0) throw table.error("scale", "found 0, expected a non-zero factor");
  mapping.offset = table.optional_number("offset").value_or(0.0);
  if (const auto sign = table.optional_integer("sign")) {
    if (*sign != 1 && *sign != -1) {
      throw table.error("sign", fmt::format("found {}, expected 1 or -1", *sign));
    }
    mapping.scale *= static_cast<double>(*sign);
  }
  return mapping;
}

Scenario scenario_of(TomlTable root, const std::filesystem::path& file) {
  const std::filesystem::path folder = file.parent_path();
  Scenario scenario;
  scenario.file = file;
  scenario.text = root.text();
  if (const auto schema = root.integer("schema"); schema != 1) {
    throw root.error("schema", fmt::format("found {}, expected 1", schema));
  }
  scenario.name = root.string("name");
  scenario.plant = folder / root.string("plant");
  scenario.bank = folder / root.string("bank");
  scenario.dbc = folder / root.string("dbc");
  if (const auto bus = root.optional_string("bus")) {
    if (!is_bus_name(*bus)) {
      throw root.error("bus", fmt::format("found \"{}\", expected {}", *bus, kBusNamesHelp));
    }
    scenario.bus = *bus;
  }
  scenario.duration_s = positive(root, "duration_s");
  if (scenario.duration_s > kMaxDuration_s) {
    throw root.error("duration_s", fmt::format("found {}, expected at most {}", scenario.duration_s,
                                               kMaxDuration_s));
  }
  scenario.seed = root.optional_integer("seed").value_or(1);
  scenario.initial_state = root.optional_vector("initial_state", -1);
  scenario.is_initial_state_known = root.optional_boolean("initial_state_known").value_or(false);
  if (auto simulation = root.optional_table("simulation")) {
    scenario.integration = read_simulation(*simulation);
  }
  if (auto controller = root.optional_table("controller")) {
    scenario.controller = read_controller(*controller);
  }
  for (const TomlTable& table : root.tables("fault")) {
    scenario.injections.push_back(read_injection(table));
  }
  for (const TomlTable& table : root.tables("disturbance")) {
    scenario.disturbances.push_back(read_perturbation(table));
  }
  for (const TomlTable& table : root.tables("noise")) {
    scenario.noises.push_back(read_perturbation(table));
  }
  for (const TomlTable& table : root.tables("expect")) {
    scenario.expectations.push_back(read_expectation(table, scenario.duration_s));
  }
  if (auto signals = root.optional_table("signals")) {
    for (const std::string& channel : signals->keys()) {
      scenario.signals.emplace(channel, read_mapping(*signals, channel));
    }
  }
  root.finish();
  return scenario;
}

}  // namespace

Scenario read_scenario(const std::filesystem::path& file) {
  return scenario_of(TomlTable::read_file(file), file);
}

Scenario parse_scenario(std::string_view text, const std::filesystem::path& file) {
  return scenario_of(TomlTable::parse(text, file.string()), file);
}

SourcePosition position_in(const Scenario& scenario, std::string_view table, std::string_view key,
                           std::optional<std::size_t> entry) {
  TomlTable root = TomlTable::parse(scenario.text, scenario.file.string());
  if (table.empty()) return root.error(key, "").position();
  if (entry) return root.tables(table).at(*entry).error(key, "").position();
  return root.table(table).error(key, "").position();
}

}  // namespace faultline

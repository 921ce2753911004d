#include "tools/scenario_print.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

/// Something that begins at a time.
struct TimelineEntry {
  double at_s = 0.0;
  std::string words;
};

std::string until_words(const std::optional<double>& until_s) {
  return until_s ? fmt::format(" until {:g} s", *until_s) : "";
}

std::string fault_words(const Injection& injection) {
  std::string words =
      fmt::format("fault {:<8} {}", injection.target, injection_kind_name(injection.kind));
  if (!injection.with.empty()) words += " with " + injection.with;
  if (injection.value) words += fmt::format(" {:g}", *injection.value);
  if (injection.frequency_Hz > 0.0) words += fmt::format(" at {:g} Hz", injection.frequency_Hz);
  words += fmt::format(" from {:g} s{}", injection.at_s, until_words(injection.until_s));
  if (injection.ramp_s > 0.0) words += fmt::format(", ramp {:g} s", injection.ramp_s);
  if (injection.period_s) words += fmt::format(", period {:g} s", *injection.period_s);
  if (injection.probability < 1.0) {
    words += fmt::format(", in {:g} % of the cycles", 100.0 * injection.probability);
  }
  if (injection.spread_s > 0.0) {
    words += fmt::format(", up to {:g} s later (drawn)", injection.spread_s);
  }
  return words;
}

std::string perturbation_words(const Perturbation& perturbation, const char* what) {
  std::string words =
      fmt::format("{} {} {}", what, perturbation.target, perturbation_kind_name(perturbation.kind));
  if (!perturbation.file.empty()) words += " " + perturbation.file.string();
  if (perturbation.sigma) {
    words += fmt::format(" sigma {:g}", *perturbation.sigma);
  } else if (perturbation.size) {
    words += fmt::format(" {:g}", *perturbation.size);
  } else if (perturbation.kind == PerturbationKind::kGaussian ||
             perturbation.kind == PerturbationKind::kBandLimited) {
    words += " at its sigma";
  } else if (perturbation.kind != PerturbationKind::kRecorded) {
    words += " at its bound";
  }
  return words +
         fmt::format(" from {:g} s{}", perturbation.at_s, until_words(perturbation.until_s));
}

std::vector<TimelineEntry> timeline_of(const Scenario& scenario) {
  std::vector<TimelineEntry> timeline;
  for (const Perturbation& disturbance : scenario.disturbances) {
    timeline.push_back({disturbance.at_s, perturbation_words(disturbance, "disturbance")});
  }
  for (const Perturbation& noise : scenario.noises) {
    timeline.push_back({noise.at_s, perturbation_words(noise, "noise")});
  }
  for (const Injection& injection : scenario.injections) {
    timeline.push_back({injection.at_s, fault_words(injection)});
  }
  std::stable_sort(timeline.begin(), timeline.end(),
                   [](const auto& a, const auto& b) { return a.at_s < b.at_s; });
  return timeline;
}

std::string start_words(const Scenario& scenario) {
  std::vector<std::string> values;
  if (scenario.initial_state) {
    for (const double value : *scenario.initial_state) values.push_back(fmt::format("{:g}", value));
  }
  for (const auto& [state, value] : scenario.initial_states) {
    values.push_back(fmt::format("{} = {:g}", state, value));
  }
  return fmt::format(
      "{}{}", values.empty() ? "the operating point" : fmt::format("{}", fmt::join(values, ", ")),
      scenario.is_initial_state_known ? ", known to the diagnosis" : "");
}

std::string mapping_words(const std::string& channel, const ChannelMapping& mapping) {
  std::string words = fmt::format("{} = ", channel);
  if (mapping.scale != 1.0) words += fmt::format("{:g} * ", mapping.scale);
  words += mapping.signal;
  if (mapping.offset != 0.0) {
    words += fmt::format(" {} {:g}", mapping.offset < 0.0 ? "-" : "+", std::abs(mapping.offset));
  }
  return words;
}

Json perturbations_json(const std::vector<Perturbation>& perturbations) {
  Json json = Json::array();
  for (const Perturbation& perturbation : perturbations) {
    json.push_back({{"target", perturbation.target},
                    {"kind", perturbation_kind_name(perturbation.kind)},
                    {"size", perturbation.size ? Json(*perturbation.size) : Json(nullptr)},
                    {"at_s", perturbation.at_s}});
  }
  return json;
}

}  // namespace

void print_scenario(std::FILE* out, const Scenario& scenario) {
  fmt::print(out,
             "{}: scenario \"{}\", {:g} s on {}, seed {}\n  plant {}\n  bank  {}\n  dbc   {}\n",
             scenario.file.string(), scenario.name, scenario.duration_s, scenario.bus,
             scenario.seed, scenario.plant.string(), scenario.bank.string(), scenario.dbc.string());
  for (const IncludedText& include : scenario.includes) {
    fmt::print(out, "  includes {}\n", include.name);
  }
  fmt::print(out, "  starts at {}\n", start_words(scenario));
  for (const auto& [channel, mapping] : scenario.signals) {
    fmt::print(out, "  signal {}\n", mapping_words(channel, mapping));
  }
  for (const auto& [message, cycles] : scenario.rates) {
    fmt::print(out, "  message {} every {} cycles\n", message, cycles);
  }
  for (const TimelineEntry& entry : timeline_of(scenario)) {
    fmt::print(out, "  {}\n", entry.words);
  }
  for (const Expectation& expectation : scenario.expectations) {
    fmt::print(out, "  expects {}\n", expectation_words(expectation));
  }
}

Json scenario_json(const Scenario& scenario) {
  Json json{{"kind", "scenario"},
            {"name", scenario.name},
            {"duration_s", scenario.duration_s},
            {"seed", scenario.seed},
            {"bus", scenario.bus},
            {"plant", scenario.plant.string()},
            {"bank", scenario.bank.string()},
            {"dbc", scenario.dbc.string()},
            {"includes", Json::array()},
            {"faults", Json::array()},
            {"expectations", scenario.expectations.size()},
            {"expect", Json::array()}};
  for (const IncludedText& include : scenario.includes) json["includes"].push_back(include.name);
  for (const Injection& injection : scenario.injections) {
    json["faults"].push_back({{"target", injection.target},
                              {"kind", injection_kind_name(injection.kind)},
                              {"value", injection.value ? Json(*injection.value) : Json(nullptr)},
                              {"at_s", injection.at_s}});
  }
  json["disturbances"] = perturbations_json(scenario.disturbances);
  json["noises"] = perturbations_json(scenario.noises);
  for (const Expectation& expectation : scenario.expectations) {
    json["expect"].push_back(expectation_words(expectation));
  }
  return json;
}

}  // namespace faultline

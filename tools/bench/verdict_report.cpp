#include "tools/bench/verdict_report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

namespace faultline {

using Json = nlohmann::ordered_json;

Json seconds_or_null(const std::optional<double>& value_s) {
  return value_s ? Json(*value_s) : Json(nullptr);
}

Json verdict_json(const VerdictEntry& entry) {
  Json json{{"t_s", entry.t_s}, {"verdict", verdict_name(entry.verdict)}};
  json["faults"] = entry.verdict == Verdict::kIsolated ? Json(entry.sets.front()) : Json::array();
  if (entry.verdict == Verdict::kAmbiguous || entry.cause == Cause::kPartial) {
    json["candidates"] = entry.sets;
  }
  json["cause"] = cause_name(entry.cause);
  if (entry.verdict == Verdict::kInhibited) json["blame"] = entry.blame;
  json["onset_s"] = seconds_or_null(entry.onset_s);
  if (entry.verdict == Verdict::kIsolated) {
    json["estimates"] = Json::array();
    for (const EstimateEntry& estimate : entry.estimates) {
      json["estimates"].push_back(
          {{"fault", estimate.fault},
           {"value", estimate.value},
           {"deviation", estimate.deviation < 0.0 ? Json(nullptr) : Json(estimate.deviation)},
           {"bound", estimate.bound < 0.0 ? Json(nullptr) : Json(estimate.bound)}});
    }
    if (!entry.no_estimate.empty()) json["no_estimate"] = entry.no_estimate;
  }
  return json;
}

Json expectation_json(const ExpectationOutcome& outcome) {
  Json json{{"from_s", outcome.expectation.from_s},
            {"until_s", outcome.expectation.until_s},
            {"verdict", verdict_name(outcome.expectation.verdict)},
            {"faults", outcome.expectation.faults},
            {"met", outcome.is_met},
            {"samples", outcome.samples}};
  if (outcome.first_unmet) json["first_unmet"] = verdict_json(*outcome.first_unmet);
  return json;
}

std::string expectation_text(const ExpectationOutcome& outcome) {
  const Expectation& expectation = outcome.expectation;
  std::string text =
      fmt::format("{} {:g} .. {:g} s  {}", outcome.is_met ? "met    " : "NOT MET",
                  expectation.from_s, expectation.until_s, verdict_name(expectation.verdict));
  if (!expectation.faults.empty()) {
    text += fmt::format(" {}", fmt::join(expectation.faults, ", "));
  }
  if (outcome.first_unmet) {
    const std::string& note = outcome.first_unmet->note;
    text += fmt::format("; found {}{} at {:g} s", verdict_text(*outcome.first_unmet),
                        note.empty() ? "" : " (" + note + ")", outcome.first_unmet->t_s);
  } else if (outcome.samples == 0) {
    text += "; the run had no sample there";
  }
  return text;
}

}  // namespace faultline

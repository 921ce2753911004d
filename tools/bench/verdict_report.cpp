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
  const Expectation& expectation = outcome.expectation;
  Json verdicts = Json::array();
  for (const Verdict verdict : expectation.verdicts) verdicts.push_back(verdict_name(verdict));
  Json json{{"from_s", expectation.from_s},
            {"until_s", expectation.until_s},
            {"verdict", verdicts.size() == 1 ? verdicts.front() : verdicts},
            {"faults", expectation.faults}};
  if (!expectation.sets.empty()) json["sets"] = expectation.sets;
  if (expectation.within_s) json["within_s"] = *expectation.within_s;
  for (const ExpectedEstimate& estimate : expectation.estimates) {
    json["estimate"][estimate.fault] = {{"value", estimate.value},
                                        {"tolerance", estimate.tolerance}};
  }
  if (expectation.has_no_false_alarm) json["no_false_alarm"] = true;
  if (!expectation.blamed.empty()) json["blame"] = expectation.blamed;
  if (!expectation.blamed_faults.empty()) json["blame_fault"] = expectation.blamed_faults;
  json["text"] = expectation_words(expectation);
  json["met"] = outcome.is_met;
  json["samples"] = outcome.samples;
  if (outcome.delay_s) json["delay_s"] = *outcome.delay_s;
  if (!outcome.found.empty()) json["found"] = outcome.found;
  if (outcome.first_unmet) json["first_unmet"] = verdict_json(*outcome.first_unmet);
  return json;
}

std::string expectation_text(const ExpectationOutcome& outcome) {
  std::string text = fmt::format("{} {}", outcome.is_met ? "met    " : "NOT MET",
                                 expectation_words(outcome.expectation));
  if (outcome.delay_s) text += fmt::format(" (after {:.0f} ms)", *outcome.delay_s * 1e3);
  if (!outcome.found.empty()) text += "; " + outcome.found;
  return text;
}

}  // namespace faultline

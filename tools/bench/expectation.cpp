#include "tools/bench/expectation.h"

#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

std::string sets_words(const Expectation& expectation) {
  std::vector<std::string> sets;
  for (const std::vector<std::string>& set : expectation.sets) {
    sets.push_back(fmt::format("{}", fmt::join(set, ", ")));
  }
  return fmt::format("{}{}", fmt::join(sets, " | "),
                     expectation.may_have_more_sets ? " among others" : "");
}

std::string verdict_words(const Expectation& expectation, Verdict verdict) {
  std::string words(verdict_name(verdict));
  if (verdict == Verdict::kIsolated && !expectation.faults.empty())
    words += fmt::format(" {}", fmt::join(expectation.faults, ", "));
  if (verdict == Verdict::kAmbiguous && !expectation.sets.empty()) {
    words += " " + sets_words(expectation);
  }
  return words;
}

std::string blame_words(const Expectation& expectation) {
  std::string words = "blamed ";
  words += expectation.blamed.empty() ? "on a message"
                                      : fmt::format("on {}", fmt::join(expectation.blamed, " or "));
  if (!expectation.blamed_faults.empty()) {
    words += fmt::format(": {}", fmt::join(expectation.blamed_faults, " or "));
  }
  return words;
}

}  // namespace

bool Expectation::allows(Verdict verdict) const noexcept {
  return std::find(verdicts.begin(), verdicts.end(), verdict) != verdicts.end();
}

std::string expectation_words(const Expectation& expectation) {
  std::vector<std::string> verdicts;
  for (const Verdict verdict : expectation.verdicts) {
    verdicts.push_back(verdict_words(expectation, verdict));
  }
  std::string words = fmt::format("{:g} .. {:g} s  {}", expectation.from_s, expectation.until_s,
                                  fmt::join(verdicts, " or "));
  if (expectation.within_s) words += fmt::format(" within {:g} s", *expectation.within_s);
  if (expectation.has_blame()) words += "; " + blame_words(expectation);
  for (const ExpectedEstimate& estimate : expectation.estimates) {
    words += fmt::format("; {} = {:g} +- {:g}", estimate.fault, estimate.value, estimate.tolerance);
  }
  if (expectation.has_no_false_alarm) words += "; no false alarm";
  return words;
}

}  // namespace faultline

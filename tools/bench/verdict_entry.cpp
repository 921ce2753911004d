#include "tools/bench/verdict_entry.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

std::string sets_text(const std::vector<std::vector<std::string>>& sets) {
  std::vector<std::string> texts;
  for (const std::vector<std::string>& set : sets) {
    if (!set.empty()) texts.push_back(fmt::format("{}", fmt::join(set, ", ")));
  }
  return fmt::format("{}", fmt::join(texts, " | "));
}

// Digits after the point so that two of the bound's, or the deviation's, show; six significant ones
// without.
std::string estimate_text(const EstimateEntry& entry) {
  const double uncertainty = std::max(entry.bound, entry.deviation);
  if (!(uncertainty > 0.0)) return fmt::format("{} = {:.6g}", entry.fault, entry.value);
  constexpr int kMostDigits = 9;
  const int digits =
      std::clamp(1 - static_cast<int>(std::floor(std::log10(uncertainty))), 0, kMostDigits);
  return fmt::format("{} = {:.{}f}{}{:.{}f}", entry.fault, entry.value, digits,
                     entry.bound > 0.0 ? ", within " : " +- ", uncertainty, digits);
}

}  // namespace

std::string verdict_text(const VerdictEntry& entry) {
  const std::string name(verdict_name(entry.verdict));
  if (!entry.blame.empty()) return fmt::format("{} ({})", name, entry.blame);
  const std::string sets =
      entry.verdict == Verdict::kUnexplained ? std::string() : sets_text(entry.sets);
  return sets.empty() ? name : name + " " + sets;
}

std::string verdict_detail(const VerdictEntry& entry) {
  std::vector<std::string> parts;
  if (!entry.estimates.empty()) {
    std::vector<std::string> estimates;
    for (const EstimateEntry& estimate : entry.estimates) {
      estimates.push_back(estimate_text(estimate));
    }
    parts.push_back(fmt::format("{}", fmt::join(estimates, ", ")));
  }
  if (entry.cause == Cause::kPartial) {
    parts.push_back(
        fmt::format("{}, could be {} below a threshold", entry.note, sets_text(entry.sets)));
  } else if (!entry.note.empty()) {
    parts.push_back(entry.note);
  }
  if (entry.onset_s && entry.verdict != Verdict::kHealthy) {
    parts.push_back(fmt::format("onset {:.6g} s", *entry.onset_s));
  }
  if (!entry.no_estimate.empty()) parts.push_back("no estimate: " + entry.no_estimate);
  return fmt::format("{}", fmt::join(parts, "; "));
}

}  // namespace faultline

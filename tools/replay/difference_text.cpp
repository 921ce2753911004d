#include "tools/replay/difference_text.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <string_view>
#include <utility>

#include <faultline/diagnosis_t.hpp>
#include <faultline/estimate_t.hpp>
#include <faultline/residual_t.hpp>
#include <faultline/sample_t.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/lcm/log_event.h"

namespace faultline {
namespace {

/// A member's name and its value as text; equal texts mean equal bits.
using Members = std::vector<std::pair<std::string, std::string>>;

constexpr std::size_t kShown = 5;

std::string text_of(double value) {
  return fmt::format("{} ({:016x})", value, std::bit_cast<std::uint64_t>(value));
}
std::string text_of(std::int64_t value) { return fmt::format("{}", value); }
std::string text_of(std::uint8_t value) { return fmt::format("{}", value); }
std::string text_of(const std::string& value) { return '"' + value + '"'; }

std::string name_at(const std::vector<std::string>& names, std::size_t i) {
  return i < names.size() ? names[i] : fmt::format("{}", i);
}

template <class Value>
void add_all(Members& members, std::string_view what, const std::vector<std::string>& names,
             const std::vector<Value>& values) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    members.emplace_back(fmt::format("{} {}", what, name_at(names, i)), text_of(values[i]));
  }
}

std::vector<std::string> filter_names(const Bank& bank) {
  std::vector<std::string> names;
  for (const ResidualFilter& filter : bank.filters) names.push_back(filter.name);
  return names;
}

Members members_of(const sample_t& sample, const Bank& bank) {
  Members members{{"command cycle", text_of(sample.command_cycle)},
                  {"flags", fmt::format("{:#x}", sample.flags)}};
  add_all(members, "y", bank.output_names, sample.y);
  add_all(members, "u", bank.input_names, sample.u);
  add_all(members, "freshness of", bank.output_names, sample.y_is_fresh);
  add_all(members, "freshness of", bank.input_names, sample.u_is_fresh);
  add_all(members, "state of", bank.output_names, sample.y_state);
  add_all(members, "state of", bank.input_names, sample.u_state);
  add_all(members, "age of", bank.output_names, sample.y_age);
  add_all(members, "age of", bank.input_names, sample.u_age);
  return members;
}

Members members_of(const residual_t& residual, const Bank& bank) {
  std::vector<std::string> rows;
  for (const ResidualFilter& filter : bank.filters) {
    for (Eigen::Index row = 0; row < filter.H.rows(); ++row) {
      rows.push_back(filter.H.rows() == 1 ? filter.name : fmt::format("{}[{}]", filter.name, row));
    }
  }
  Members members;
  add_all(members, "residual", rows, residual.residual);
  add_all(members, "row threshold", rows, residual.row_threshold);
  add_all(members, "evaluation", filter_names(bank), residual.evaluation);
  add_all(members, "threshold", filter_names(bank), residual.threshold);
  add_all(members, "fired", filter_names(bank), residual.fired);
  return members;
}

Members members_of(const diagnosis_t& diagnosis, const Bank& /*bank*/) {
  std::vector<std::string> sets;
  for (const fault_set_t& set : diagnosis.sets) {
    sets.push_back(fmt::format("{}", fmt::join(set.faults, ", ")));
  }
  return {{"verdict", text_of(diagnosis.verdict)},
          {"sets", text_of(fmt::format("{}", fmt::join(sets, " | ")))},
          {"set count", text_of(static_cast<std::int64_t>(diagnosis.set_total))},
          {"cause", text_of(diagnosis.cause)},
          {"blame", text_of(diagnosis.blame)},
          {"since cycle", text_of(diagnosis.since_cycle)},
          {"onset cycle", text_of(diagnosis.onset_cycle)}};
}

Members members_of(const estimate_t& estimate, const Bank& /*bank*/) {
  Members members{{"onset cycle", text_of(estimate.onset_cycle)},
                  {"reason", text_of(estimate.reason)},
                  {"faults", text_of(fmt::format("{}", fmt::join(estimate.fault, ", ")))}};
  if (estimate.fault_count == 0) return members;
  add_all(members, "estimate of", estimate.fault, estimate.estimate);
  add_all(members, "deviation of", estimate.fault, estimate.deviation);
  add_all(members, "bound of", estimate.fault, estimate.bound);
  return members;
}

template <class Message>
std::vector<std::string> differing_members(const ResultComparison::Difference& difference,
                                           std::string_view layout, const Bank& bank) {
  Message recorded, replayed;
  if (!decode_message(difference.recorded, layout, recorded)) {
    return {"  the recorded message is damaged"};
  }
  if (!decode_message(difference.replayed, layout, replayed)) {
    return {"  the replay has none"};
  }
  if (recorded.cycle != replayed.cycle) {
    return {fmt::format("  recorded for cycle {}, replayed for cycle {}", recorded.cycle,
                        replayed.cycle)};
  }
  const Members a = members_of(recorded, bank), b = members_of(replayed, bank);
  std::vector<std::string> lines;
  if (a.size() != b.size()) {
    lines.push_back(fmt::format("  recorded {} values, replayed {}", a.size(), b.size()));
  }
  std::size_t count = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    if (a[i] == b[i]) continue;
    if (++count > kShown) continue;
    lines.push_back(
        fmt::format("  {}: recorded {}, replayed {}", a[i].first, a[i].second, b[i].second));
  }
  if (count > kShown) lines.push_back(fmt::format("  and {} more", count - kShown));
  return lines;
}

}  // namespace

std::vector<std::string> describe(const ResultComparison::Difference& difference,
                                  const Bank& bank) {
  std::vector<std::string> lines{
      fmt::format("{}, cycle {}", result_channel_name(difference.channel), difference.cycle)};
  std::vector<std::string> members;
  switch (difference.channel) {
    case ResultChannel::kSample:
      members = differing_members<sample_t>(difference, layout::kSample, bank);
      break;
    case ResultChannel::kResidual:
      members = differing_members<residual_t>(difference, layout::kResidual, bank);
      break;
    case ResultChannel::kDiagnosis:
      members = differing_members<diagnosis_t>(difference, layout::kDiagnosis, bank);
      break;
    case ResultChannel::kEstimate:
      members = differing_members<estimate_t>(difference, layout::kEstimate, bank);
      break;
  }
  lines.insert(lines.end(), members.begin(), members.end());
  return lines;
}

}  // namespace faultline

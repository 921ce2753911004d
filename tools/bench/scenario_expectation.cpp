#include <algorithm>
#include <array>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "drivers/signal/sample.h"
#include "tools/bench/scenario_tables.h"

namespace faultline {
namespace {

constexpr std::array kVerdicts = {Verdict::kHealthy, Verdict::kIsolated, Verdict::kAmbiguous,
                                  Verdict::kUnexplained, Verdict::kInhibited};
constexpr std::array kMessageFaults = {
    MessageFault::kMissing,         MessageFault::kLate,
    MessageFault::kRepeated,        MessageFault::kTooShort,
    MessageFault::kNotFinite,       MessageFault::kWrongCrc,
    MessageFault::kCounterRepeated, MessageFault::kCounterOutOfRange,
    MessageFault::kCounterGap};

template <typename Value, std::size_t kSize>
std::vector<std::string> names_of(const std::array<Value, kSize>& values,
                                  std::string_view (*name)(Value) noexcept) {
  std::vector<std::string> names;
  for (const Value value : values) names.emplace_back(name(value));
  return names;
}

/// A word or a list of different words, each of them one of `known` unless that is empty.
std::vector<std::string> read_words(TomlTable& table, std::string_view key,
                                    const std::vector<std::string>& known) {
  std::vector<std::string> words =
      table.is_string(key) ? std::vector<std::string>{table.string(key)} : table.strings(key);
  if (words.empty()) throw table.error(key, "found an empty list, expected at least one name");
  for (auto word = words.begin(); word != words.end(); ++word) {
    if (std::find(words.begin(), word, *word) != word) {
      throw table.error(key, fmt::format("found \"{}\" twice, expected it once", *word));
    }
    if (known.empty() || std::find(known.begin(), known.end(), *word) != known.end()) continue;
    const auto near = nearest_name(*word, known);
    throw table.error(key, fmt::format("found \"{}\", expected one of \"{}\"{}", *word,
                                       fmt::join(known, "\", \""),
                                       near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
  }
  return words;
}

/// Fault names of one set, sorted.
std::vector<std::string> sorted_set(const TomlTable& table, std::string_view key,
                                    std::vector<std::string> set) {
  if (set.empty()) throw table.error(key, "found an empty list, expected the faults");
  std::sort(set.begin(), set.end());
  const auto twice = std::adjacent_find(set.begin(), set.end());
  if (twice != set.end()) {
    throw table.error(key, fmt::format("found \"{}\" twice, expected it once", *twice));
  }
  return set;
}

void read_stretch(TomlTable& table, double duration_s, Expectation& expectation) {
  expectation.from_s = require_time(table, "from_s", table.number("from_s"));
  expectation.until_s = table.number("until_s");
  if (expectation.until_s < expectation.from_s) {
    throw table.error("until_s", fmt::format("found {}, expected at least from_s = {}",
                                             expectation.until_s, expectation.from_s));
  }
  if (expectation.from_s > duration_s) {
    throw table.error("from_s", fmt::format("found {}, expected at most duration_s = {}",
                                            expectation.from_s, duration_s));
  }
}

/// Those written; else those that the other keys leave.
void read_verdicts(TomlTable& table, Expectation& expectation) {
  expectation.has_no_false_alarm = table.optional_boolean("no_false_alarm").value_or(false);
  if (table.has("verdict")) {
    const std::vector<std::string> words =
        read_words(table, "verdict", names_of(kVerdicts, verdict_name));
    for (const Verdict verdict : kVerdicts) {
      const bool is_named =
          std::find(words.begin(), words.end(), verdict_name(verdict)) != words.end();
      if (is_named) expectation.verdicts.push_back(verdict);
    }
  } else if (table.has("blame") || table.has("blame_fault")) {
    expectation.verdicts = {Verdict::kInhibited};
  } else if (expectation.has_no_false_alarm) {
    expectation.verdicts = {Verdict::kHealthy, Verdict::kInhibited};
  } else {
    static_cast<void>(table.string("verdict"));  // says what is missing
  }
  for (const Verdict verdict : expectation.verdicts) {
    if (!expectation.has_no_false_alarm || verdict == Verdict::kHealthy ||
        verdict == Verdict::kInhibited) {
      continue;
    }
    throw table.error("verdict",
                      fmt::format("found \"{}\" with no_false_alarm = true, expected \"healthy\" "
                                  "or \"inhibited\": every other verdict is an alarm",
                                  verdict_name(verdict)));
  }
}

/// `key` makes sense with `verdict` only.
void require_verdict(const TomlTable& table, const Expectation& expectation, std::string_view key,
                     Verdict verdict) {
  if (expectation.allows(verdict)) return;
  std::vector<std::string_view> found;
  for (const Verdict allowed : expectation.verdicts) found.push_back(verdict_name(allowed));
  throw table.error(key, fmt::format("found it with the verdict \"{}\", expected none: it goes "
                                     "with \"{}\" only",
                                     fmt::join(found, "\", \""), verdict_name(verdict)));
}

void read_faults(TomlTable& table, Expectation& expectation) {
  if (table.has("faults")) require_verdict(table, expectation, "faults", Verdict::kIsolated);
  if (!expectation.allows(Verdict::kIsolated)) return;
  // Beside others, isolated may stay open: what matters is then that the fault is seen.
  if (expectation.verdicts.size() > 1 && !table.has("faults")) return;
  expectation.faults = sorted_set(table, "faults", table.strings("faults"));
}

/// sets = [["u1"], ["u2"]], or sets = { includes = [["u1"]] }.
void read_sets(TomlTable& table, Expectation& expectation) {
  if (!table.has("sets")) return;
  require_verdict(table, expectation, "sets", Verdict::kAmbiguous);
  expectation.may_have_more_sets = table.is_table("sets");
  std::vector<std::vector<std::string>> sets;
  if (expectation.may_have_more_sets) {
    sets = table.table("sets").string_lists("includes");
  } else {
    sets = table.string_lists("sets");
  }
  const std::size_t fewest = expectation.may_have_more_sets ? 1 : 2;
  if (sets.size() < fewest || sets.size() > Decision::kMaxListed) {
    throw table.error(
        "sets",
        fmt::format("found {} fault set{}, expected {} to {}: a verdict lists no more", sets.size(),
                    sets.size() == 1 ? "" : "s", fewest, Decision::kMaxListed));
  }
  for (std::vector<std::string>& set : sets) {
    expectation.sets.push_back(sorted_set(table, "sets", std::move(set)));
  }
  std::sort(expectation.sets.begin(), expectation.sets.end());
  const auto twice = std::adjacent_find(expectation.sets.begin(), expectation.sets.end());
  if (twice != expectation.sets.end()) {
    throw table.error(
        "sets", fmt::format("found the set {} twice, expected it once", fmt::join(*twice, ", ")));
  }
}

void read_delay(TomlTable& table, Expectation& expectation) {
  expectation.within_s = table.optional_number("within_s");
  if (!expectation.within_s) return;
  require_time(table, "within_s", *expectation.within_s);
  if (!table.has("verdict") && !table.has("blame") && !table.has("blame_fault")) {
    throw table.error("within_s",
                      "found it without a verdict, expected one that must stand after that time");
  }
  const double length_s = expectation.until_s - expectation.from_s;
  if (*expectation.within_s > length_s) {
    throw table.error("within_s", fmt::format("found {}, expected at most until_s - from_s = {:g}",
                                              *expectation.within_s, length_s));
  }
}

double read_tolerance(TomlTable table, std::string_view key) {
  const double tolerance = table.number(key);
  if (tolerance < 0.0) {
    throw table.error(key, fmt::format("found {}, expected zero or more", tolerance));
  }
  return tolerance;
}

/// estimate = { u2 = 2.0 } with one tolerance, or one per fault: tolerance = { u2 = 0.1 }.
void read_estimates(TomlTable& table, Expectation& expectation) {
  if (!table.has("estimate")) {
    if (!table.has("tolerance")) return;
    throw table.error("tolerance", "found it without estimate, expected both");
  }
  require_verdict(table, expectation, "estimate", Verdict::kIsolated);
  TomlTable values = table.table("estimate");
  const bool has_one_each = table.is_table("tolerance");
  const TomlTable tolerances = has_one_each ? table.table("tolerance") : table;
  for (const std::string& fault : values.keys()) {
    const std::vector<std::string>& faults = expectation.faults;
    if (std::find(faults.begin(), faults.end(), fault) == faults.end()) {
      throw values.error(fault, fmt::format("found no such name in faults, expected one of {}: "
                                            "isolated faults are estimated",
                                            fmt::join(faults, ", ")));
    }
    expectation.estimates.push_back(
        {fault, values.number(fault),
         read_tolerance(tolerances, has_one_each ? fault : "tolerance")});
  }
  if (expectation.estimates.empty()) {
    throw table.error("estimate", "found an empty table, expected a value per fault");
  }
}

void read_blame(TomlTable& table, Expectation& expectation) {
  for (const char* const key : {"blame", "blame_fault"}) {
    if (table.has(key)) require_verdict(table, expectation, key, Verdict::kInhibited);
  }
  if (table.has("blame")) expectation.blamed = read_words(table, "blame", {});
  if (table.has("blame_fault")) {
    expectation.blamed_faults =
        read_words(table, "blame_fault", names_of(kMessageFaults, message_fault_name));
  }
}

bool has_common(const std::vector<std::string>& a, const std::vector<std::string>& b) {
  return std::any_of(a.begin(), a.end(), [&](const std::string& name) {
    return std::find(b.begin(), b.end(), name) != b.end();
  });
}

bool can_agree_on(Verdict verdict, const Expectation& a, const Expectation& b) {
  if (!a.allows(verdict) || !b.allows(verdict)) return false;
  if (verdict == Verdict::kIsolated) {
    return a.faults.empty() || b.faults.empty() || a.faults == b.faults;
  }
  if (verdict == Verdict::kAmbiguous && !a.sets.empty() && !b.sets.empty()) {
    const auto holds = [](const Expectation& exact, const Expectation& other) {
      return exact.may_have_more_sets || std::includes(exact.sets.begin(), exact.sets.end(),
                                                       other.sets.begin(), other.sets.end());
    };
    return holds(a, b) && holds(b, a);
  }
  if (verdict == Verdict::kInhibited && !a.blamed.empty() && !b.blamed.empty()) {
    return has_common(a.blamed, b.blamed);
  }
  return true;
}

}  // namespace

Expectation read_expectation(TomlTable table, double duration_s) {
  Expectation expectation;
  read_stretch(table, duration_s, expectation);
  read_verdicts(table, expectation);
  read_faults(table, expectation);
  read_sets(table, expectation);
  read_delay(table, expectation);
  read_estimates(table, expectation);
  read_blame(table, expectation);
  return expectation;
}

bool contradict(const Expectation& a, const Expectation& b) {
  const double begin_s = std::max(a.deadline_s(), b.deadline_s());
  if (begin_s > std::min(a.until_s, b.until_s)) return false;
  return std::none_of(kVerdicts.begin(), kVerdicts.end(),
                      [&](Verdict verdict) { return can_agree_on(verdict, a, b); });
}

}  // namespace faultline

#include "tools/bank_print.h"

#include <algorithm>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/bench/run_history.h"
#include "tools/observer_print.h"
#include "tools/threshold_print.h"

namespace faultline {
namespace {

// A part of a dependence, "u1, u2 = (2, 1)·g".
std::string part_text(const Bank& bank, const std::vector<std::size_t>& faults,
                      const std::vector<double>& weights) {
  std::vector<std::string> numbers;
  for (const double weight : weights) numbers.push_back(fmt::format("{:.4g}", weight));
  return fmt::format("({}) = ({})·g", join_names(bank.fault_names, faults),
                     fmt::join(numbers, ", "));
}

// Both sides of Σ weight·(column) = 0 as positive as they go, at most p faults on each, the
// smallest weight one.
std::string confusion_text(const Bank& bank, const ConfusableFaults& set) {
  std::vector<std::size_t> left, right;
  std::vector<double> left_weights, right_weights;
  double unit = 0.0;
  for (const double weight : set.weights) {
    if (weight != 0.0 && (unit == 0.0 || std::abs(weight) < unit)) unit = std::abs(weight);
  }
  const auto positive = std::count_if(set.weights.begin(), set.weights.end(),
                                      [](double weight) { return weight > 0.0; });
  const auto negative = std::ssize(set.weights) - positive;
  const auto p = static_cast<std::ptrdiff_t>(bank.concurrent);
  const bool is_by_sign = positive <= p && negative <= p;
  for (std::size_t i = 0; i < set.faults.size(); ++i) {
    const bool is_left = is_by_sign ? set.weights[i] > 0.0 : i < bank.concurrent;
    const double weight = (is_left ? set.weights[i] : -set.weights[i]) / unit;
    (is_left ? left : right).push_back(set.faults[i]);
    (is_left ? left_weights : right_weights).push_back(weight);
  }
  if (right.empty()) return part_text(bank, left, left_weights) + " looks like no fault";
  if (left.empty()) return part_text(bank, right, right_weights) + " looks like no fault";
  return fmt::format("{} looks like {}, whatever the course g", part_text(bank, left, left_weights),
                     part_text(bank, right, right_weights));
}

const char* glyph(Sensitivity sensitivity) {
  switch (sensitivity) {
    case Sensitivity::kNone:
      return "·";
    case Sensitivity::kTransient:
      return "~";
    case Sensitivity::kSteady:
      break;
  }
  return "■";
}

std::size_t longest(const std::vector<std::string>& names, std::size_t least) {
  for (const std::string& name : names) least = std::max(least, name.size());
  return least;
}

/// Largest gain from what the residual ignores (faults, decoupled disturbances).
double leakage(const Bank& bank, const ResidualFilter& filter) {
  double largest = 0.0;
  for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
    if (filter.sees[j] == Sensitivity::kNone) {
      largest = std::max(largest, filter.certificate.fault_gain[j]);
    }
  }
  for (std::size_t i = 0; i < bank.disturbances.size(); ++i) {
    if (bank.disturbances[i].is_ignored()) {
      largest = std::max(largest, filter.certificate.disturbance_gain[i]);
    }
  }
  return largest;
}

std::string gain_range(const ResidualFilter& filter) {
  double smallest = 0.0, largest = 0.0;
  for (std::size_t j = 0; j < filter.sees.size(); ++j) {
    if (filter.sees[j] != Sensitivity::kSteady) continue;
    const double gain = filter.certificate.dc_gain[j];
    smallest = smallest == 0.0 ? gain : std::min(smallest, gain);
    largest = std::max(largest, gain);
  }
  if (largest == 0.0) return "only ~";
  if (largest - smallest < 1e-6 * largest) return fmt::format("{:.3g}", largest);
  return fmt::format("{:.3g}..{:.3g}", smallest, largest);
}

double smallest_margin(const ResidualFilter& filter) {
  double smallest = 1.0;
  for (std::size_t j = 0; j < filter.sees.size(); ++j) {
    if (filter.sees[j] != Sensitivity::kNone) {
      smallest = std::min(smallest, filter.certificate.margin[j]);
    }
  }
  return smallest;
}

void print_structure(std::FILE* out, const Bank& bank) {
  std::vector<std::string> names;
  for (const ResidualFilter& filter : bank.filters) names.push_back(filter.name);
  const std::size_t width = longest(names, 8);
  fmt::print(out, "\n  {:<{}}", "", width);
  for (const std::string& fault : bank.fault_names) fmt::print(out, " {}", fault);
  fmt::print(out, "   {:>10} {:>8} {:>7} {:>9} {:>5} {:>4} {:>7} {:>7}\n", "gain", "leakage",
             "margin", "threshold", "order", "rows", "|pole|", "forgets");
  for (const ResidualFilter& filter : bank.filters) {
    fmt::print(out, "  {:<{}}", filter.name, width);
    for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
      const std::size_t column = bank.fault_names[j].size();
      fmt::print(out, " {:>{}}{}{:>{}}", "", (column - 1) / 2, glyph(filter.sees[j]), "",
                 column / 2);
    }
    fmt::print(out, "   {:>10} {:>8.1g} {:>7.3g} {:>9.4g} {:>5} {:>4} {:>7.4f} {:>5.2f} s\n",
               gain_range(filter), leakage(bank, filter), smallest_margin(filter), filter.threshold,
               filter.F.rows(), filter.H.rows(), filter.certificate.spectral_radius,
               filter.forget_samples * bank.sample_time_s);
  }
  fmt::print(out,
             "\n  ■ seen, ~ seen only while it changes, · ignored. gain: from a constant fault of "
             "size one;\n  leakage: most that passes from what it ignores, at any frequency; "
             "margin: distance of the\n  nearest fault from what it ignores (0 .. 1)\n");
}

std::string size_text(double size) { return size > 0.0 ? fmt::format("{:.3g}", size) : "-"; }

std::string delay_text(double delay_s) {
  return delay_s > 0.0 ? fmt::format("{:.0f} ms", 1e3 * delay_s) : "-";
}

}  // namespace

std::string join_names(const std::vector<std::string>& names,
                       const std::vector<std::size_t>& indices) {
  std::vector<std::string> chosen;
  for (const std::size_t i : indices) chosen.push_back(names[i]);
  return fmt::format("{}", fmt::join(chosen, ", "));
}

FaultReach fault_reach(const Bank& bank, std::size_t fault) {
  FaultReach reach;
  const bool is_told_apart = has_own_signature(bank, fault);
  const double settled_s = (bank.decision.settle - 1) * bank.sample_time_s;
  Sensitivity detected_by = Sensitivity::kNone;
  for (const ResidualFilter& filter : bank.filters) {
    const Sensitivity sensitivity = filter.sees[fault];
    if (sensitivity == Sensitivity::kTransient) reach.transient_only.push_back(filter.name);
    const double size = filter.certificate.smallest_fault[fault];
    if (sensitivity == Sensitivity::kNone || size == 0.0) continue;
    const double delay_s = filter.certificate.delay_s[fault] + settled_s;
    // A residual that keeps firing counts before one that soon forgets.
    if (sensitivity > detected_by || (sensitivity == detected_by && size < reach.detected_from)) {
      detected_by = sensitivity;
      reach.detected_from = size;
      reach.detection_delay_s = delay_s;
    }
    if (sensitivity == Sensitivity::kSteady && is_told_apart) {
      reach.isolated_from = std::max(reach.isolated_from, size);
      reach.isolation_delay_s = std::max(reach.isolation_delay_s, delay_s);
    }
  }
  return reach;
}

void print_fault_reach(std::FILE* out, const Bank& bank) {
  const std::size_t width = longest(bank.fault_names, 8);
  fmt::print(out, "\n  {:<{}} {:>14} {:>9} {:>14} {:>9}\n", "fault", width, "detected from",
             "after", "isolated from", "after");
  for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
    const FaultReach reach = fault_reach(bank, j);
    fmt::print(out, "  {:<{}} {:>14} {:>9} {:>14} {:>9}", bank.fault_names[j], width,
               size_text(reach.detected_from), delay_text(reach.detection_delay_s),
               size_text(reach.isolated_from), delay_text(reach.isolation_delay_s));
    if (!reach.transient_only.empty()) {
      fmt::print(out, "   only while it changes: {}", fmt::join(reach.transient_only, ", "));
    }
    fmt::print(out, "\n");
  }
  fmt::print(out,
             "\n  smallest constant fault alone, in its unit, and how long a step of twice that "
             "takes\n");
}

void print_isolability(std::FILE* out, const Bank& bank) {
  const IsolabilityCertificate& isolability = bank.isolability;
  const std::string count =
      bank.concurrent == 1 ? "single faults" : fmt::format("up to {} faults", bank.concurrent);
  fmt::print(out, "\n  signatures of {} {}\n", count,
             isolability.are_signatures_distinct ? "are distinct" : "are NOT distinct");
  if (isolability.is_strongly_isolable) {
    fmt::print(out, "  strongly isolable: no two sets of {} look alike, whatever their courses\n",
               count);
    return;
  }
  // Beyond a screenful the data (--json) is the better place.
  constexpr std::size_t kListed = 12;
  const std::size_t listed = std::min(kListed, isolability.confusable.size());
  fmt::print(out, "  not strongly isolable: {}\n",
             listed == 0 ? "not proved" : "with the right courses these look alike");
  for (std::size_t i = 0; i < listed; ++i) {
    const ConfusableFaults& set = isolability.confusable[i];
    fmt::print(
        out, "    {{{}}}{}\n", join_names(bank.fault_names, set.faults),
        set.weights.empty() ? ", each with a course of its own" : ": " + confusion_text(bank, set));
  }
  if (isolability.confusable.size() > listed) {
    fmt::print(out, "    and {} more\n", isolability.confusable.size() - listed);
  }
  if (!isolability.is_list_complete) fmt::print(out, "    and perhaps others: the list is cut\n");
}

void print_bank(std::FILE* out, const Bank& bank) {
  fmt::print(
      out,
      "\n  method {}, {} domain, {} residuals, isolates up to {} fault{} at a time, one step "
      "every {:g} s\n  fires above its threshold for {} sample{}; a verdict needs its "
      "signature to stand for {};\n  a fault's size is estimated from {} samples\n",
      bank.method, domain_name(bank.domain), bank.filters.size(), bank.concurrent,
      bank.concurrent == 1 ? "" : "s", bank.sample_time_s, bank.decision.dwell,
      bank.decision.dwell == 1 ? "" : "s", bank.decision.settle, bank.decision.window);
  if (bank.decision.clearing > bank.decision.settle) {
    fmt::print(out,
               "  while residuals clear, what is left of them is another fault only after {} "
               "samples\n",
               bank.decision.clearing);
  }
  print_structure(out, bank);
  print_fault_reach(out, bank);
  print_isolability(out, bank);
  print_observer_proofs(out, bank);
  print_thresholds(out, bank);
}

}  // namespace faultline

#include "diagnosis/design/structure.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

// Bounds the proof that a structure is the smallest: looks at a bit of a set. About half a second.
constexpr std::size_t kMaxWork = 200'000'000;
// Bounds the residuals that are designed to choose among: about a second at twenty states.
constexpr std::size_t kMaxCandidates = 1000;

std::size_t fault_index(const PlantModel& plant, const BankRequest& request,
                        const std::string& name) {
  const std::vector<std::string> names = plant.fault_names();
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) {
    const std::optional<std::string> near = nearest_name(name, names);
    throw request_error(request, "structure",
                        fmt::format("found \"{}\", expected names of the plant's faults{}", name,
                                    near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
  }
  return static_cast<std::size_t>(found - names.begin());
}

FaultSet given_set(const PlantModel& plant, const BankRequest& request,
                   const std::vector<std::string>& names) {
  FaultSet set;
  for (const std::string& name : names) {
    set.push_back(fault_index(plant, request, name));
  }
  std::sort(set.begin(), set.end());
  if (std::adjacent_find(set.begin(), set.end()) != set.end()) {
    throw request_error(
        request, "structure",
        fmt::format("found [{}], expected each fault once in a set", fmt::join(names, ", ")));
  }
  if (set.size() == plant.faults.size()) {
    throw request_error(request, "structure",
                        fmt::format("found [{}], expected a set that leaves a fault to be seen",
                                    fmt::join(names, ", ")));
  }
  return set;
}

// Sets of up to p faults.
std::vector<FaultSet> all_sets(std::size_t fault_count, std::size_t concurrent) {
  std::vector<FaultSet> sets;
  for (std::size_t size = 0; size <= concurrent; ++size) {
    for (FaultSet& set : combinations(fault_count, size)) {
      sets.push_back(std::move(set));
    }
  }
  return sets;
}

// Whether a residual sees a member, and whether it must fire for the set: see DecisionTable.
struct Prediction {
  bool sees = false;
  bool must_fire = false;
};

Prediction predict(const std::vector<Sensitivity>& row, const FaultSet& set) {
  std::size_t seen = 0;
  bool is_steady = false;
  for (const std::size_t j : set) {
    if (row[j] != Sensitivity::kNone) {
      ++seen;
      is_steady = row[j] == Sensitivity::kSteady;
    }
  }
  return {seen > 0, seen == 1 && is_steady};
}

// A set of residuals as bits.
using Bits = std::vector<std::uint64_t>;

bool contains(const Bits& bits, std::size_t i) { return ((bits[i / 64] >> (i % 64)) & 1U) != 0; }

std::size_t count(const Bits& bits) {
  std::size_t total = 0;
  for (const std::uint64_t word : bits) {
    total += static_cast<std::size_t>(std::popcount(word));
  }
  return total;
}

bool is_subset(const Bits& inner, const Bits& outer) {
  for (std::size_t w = 0; w < inner.size(); ++w) {
    if ((inner[w] & ~outer[w]) != 0) {
      return false;
    }
  }
  return true;
}

// Per pair of fault sets that can be told apart, the residuals of which one is needed; only the
// pairs that no other pair implies, those with fewest residuals first.
std::vector<Bits> needed_residuals(const Structure& structure, std::size_t fault_count,
                                   std::size_t concurrent) {
  const std::vector<FaultSet> sets = all_sets(fault_count, concurrent);
  std::vector<std::vector<Prediction>> predictions(sets.size());
  for (std::size_t a = 0; a < sets.size(); ++a) {
    for (const std::vector<Sensitivity>& row : structure) {
      predictions[a].push_back(predict(row, sets[a]));
    }
  }
  std::set<Bits> different;
  for (std::size_t a = 0; a < sets.size(); ++a) {
    for (std::size_t b = 0; b < sets.size() && sets[b].size() <= sets[a].size(); ++b) {
      Bits separating((structure.size() + 63) / 64);
      for (std::size_t i = 0; i < structure.size(); ++i) {
        const bool fires = predictions[a][i].sees;
        if (fires ? !predictions[b][i].sees : predictions[b][i].must_fire) {
          separating[i / 64] |= std::uint64_t{1} << (i % 64);
        }
      }
      if (count(separating) > 0) {
        different.insert(std::move(separating));
      }
    }
  }
  std::vector<Bits> needed(different.begin(), different.end());
  std::stable_sort(needed.begin(), needed.end(),
                   [](const Bits& a, const Bits& b) { return count(a) < count(b); });
  std::vector<Bits> minimal;
  for (const Bits& bits : needed) {
    if (std::none_of(minimal.begin(), minimal.end(),
                     [&](const Bits& smaller) { return is_subset(smaller, bits); })) {
      minimal.push_back(bits);
    }
  }
  return minimal;
}

// Fewest residuals that hit every set of `needed`: greedy first, then branch and bound.
class SmallestHittingSet {
 public:
  SmallestHittingSet(std::vector<Bits> needed, std::size_t residual_count)
      : needed_(std::move(needed)), residual_count_(residual_count) {}

  // `starts`: residuals from which on a greedy choice is tried; the first is 0.
  ResidualChoice run(const std::vector<std::size_t>& starts) {
    best_ = greedy(0);
    for (const std::size_t start : starts) {
      if (std::vector<std::size_t> chosen = greedy(start);
          !chosen.empty() && chosen.size() < best_.size()) {
        best_ = std::move(chosen);
      }
    }
    std::vector<std::size_t> chosen;
    descend(std::vector<bool>(needed_.size()), chosen);
    std::sort(best_.begin(), best_.end());
    return {best_, work_ < kMaxWork};
  }

 private:
  // How many sets that are not hit yet each residual would hit.
  [[nodiscard]] std::vector<std::size_t> hits(const std::vector<bool>& is_hit) const {
    std::vector<std::size_t> hits(residual_count_);
    for (std::size_t s = 0; s < needed_.size(); ++s) {
      for (std::size_t i = 0; !is_hit[s] && i < residual_count_; ++i) {
        hits[i] += contains(needed_[s], i) ? 1U : 0U;
      }
    }
    return hits;
  }

  [[nodiscard]] std::vector<bool> with(std::vector<bool> is_hit, std::size_t residual) const {
    for (std::size_t s = 0; s < needed_.size(); ++s) {
      is_hit[s] = is_hit[s] || contains(needed_[s], residual);
    }
    return is_hit;
  }

  // Of the residuals from `start` on; empty if they do not hit all.
  [[nodiscard]] std::vector<std::size_t> greedy(std::size_t start) const {
    std::vector<std::size_t> chosen;
    std::vector<bool> is_hit(needed_.size());
    while (std::find(is_hit.begin(), is_hit.end(), false) != is_hit.end()) {
      const std::vector<std::size_t> gains = hits(is_hit);
      const auto best =
          std::max_element(gains.begin() + static_cast<std::ptrdiff_t>(start), gains.end());
      if (*best == 0) {
        return {};
      }
      chosen.push_back(static_cast<std::size_t>(best - gains.begin()));
      is_hit = with(std::move(is_hit), chosen.back());
    }
    return chosen;
  }

  void descend(const std::vector<bool>& is_hit, std::vector<std::size_t>& chosen) {
    const auto open = static_cast<std::size_t>(std::count(is_hit.begin(), is_hit.end(), false));
    if (open == 0) {
      if (chosen.size() < best_.size()) {
        best_ = chosen;
      }
      return;
    }
    work_ += needed_.size() * residual_count_;
    if (work_ >= kMaxWork) {
      return;
    }
    const std::vector<std::size_t> gains = hits(is_hit);
    const std::size_t most = *std::max_element(gains.begin(), gains.end());
    if (chosen.size() + (open + most - 1) / most >= best_.size()) {
      return;  // not even the best residual, again and again, would do better
    }
    // One residual of the first open set, which has fewest, is in every solution.
    const auto first =
        static_cast<std::size_t>(std::find(is_hit.begin(), is_hit.end(), false) - is_hit.begin());
    for (std::size_t i = 0; i < residual_count_; ++i) {
      if (contains(needed_[first], i)) {
        chosen.push_back(i);
        descend(with(is_hit, i), chosen);
        chosen.pop_back();
      }
    }
  }

  std::vector<Bits> needed_;
  std::size_t residual_count_;
  std::vector<std::size_t> best_;
  std::size_t work_ = 0;
};

}  // namespace

std::vector<FaultSet> combinations(std::size_t k, std::size_t p) {
  std::vector<FaultSet> sets;
  std::vector<bool> is_chosen(k, false);
  std::fill_n(is_chosen.begin(), p, true);
  do {
    FaultSet set;
    for (std::size_t j = 0; j < k; ++j) {
      if (is_chosen[j]) {
        set.push_back(j);
      }
    }
    sets.push_back(set);
  } while (std::prev_permutation(is_chosen.begin(), is_chosen.end()));
  return sets;
}

std::vector<FaultSet> requested_sets(const PlantModel& plant, const BankRequest& request) {
  const std::size_t fault_count = plant.faults.size();
  if (request.structure == StructureChoice::kAll) {
    return combinations(fault_count, request.concurrent);
  }
  if (request.structure == StructureChoice::kDedicated) {
    return combinations(fault_count, fault_count - 1);
  }
  if (request.structure == StructureChoice::kSmallest) {
    return candidate_sets(fault_count, request.concurrent, static_cast<std::size_t>(plant.q()));
  }
  std::vector<FaultSet> sets;
  for (const std::vector<std::string>& names : request.ignored_sets) {
    FaultSet set = given_set(plant, request, names);
    if (std::find(sets.begin(), sets.end(), set) != sets.end()) {
      throw request_error(
          request, "structure",
          fmt::format("found [{}] twice, expected different sets", fmt::join(names, ", ")));
    }
    sets.push_back(std::move(set));
  }
  if (sets.empty()) {
    throw request_error(request, "structure", "found no set, expected one per residual");
  }
  return sets;
}

std::vector<FaultSet> candidate_sets(std::size_t fault_count, std::size_t concurrent,
                                     std::size_t output_count) {
  std::vector<std::size_t> sizes;
  for (std::size_t size = concurrent + 1; size < std::min(fault_count, output_count); ++size) {
    sizes.push_back(size);
  }
  const auto binomial = [&](std::size_t size) {
    const std::size_t up_to = fault_set_count(fault_count, size);
    return up_to - fault_set_count(fault_count, size - 1);
  };
  std::stable_sort(sizes.begin(), sizes.end(),
                   [&](std::size_t a, std::size_t b) { return binomial(a) < binomial(b); });
  std::vector<FaultSet> sets = combinations(fault_count, concurrent);
  for (const std::size_t size : sizes) {
    if (sets.size() + binomial(size) > kMaxCandidates) {
      break;
    }
    for (FaultSet& set : combinations(fault_count, size)) {
      sets.push_back(std::move(set));
    }
  }
  std::stable_sort(sets.begin(), sets.end(),
                   [](const FaultSet& a, const FaultSet& b) { return a.size() < b.size(); });
  return sets;
}

std::string residual_name(const FaultSet& ignores, std::size_t fault_count) {
  std::vector<std::size_t> numbers;
  for (const std::size_t j : ignores) {
    numbers.push_back(j + 1);
  }
  return numbers.empty() ? "r0"
                         : fmt::format("r{}", fmt::join(numbers, fault_count < 10 ? "" : "_"));
}

std::vector<std::vector<FaultSet>> indistinguishable_sets(const Structure& structure,
                                                          std::size_t fault_count,
                                                          std::size_t concurrent) {
  std::map<std::vector<bool>, std::vector<FaultSet>> by_signature;
  for (FaultSet& set : all_sets(fault_count, concurrent)) {
    std::vector<bool> signature;
    for (const std::vector<Sensitivity>& row : structure) {
      signature.push_back(predict(row, set).sees);
    }
    by_signature[signature].push_back(std::move(set));
  }
  std::vector<std::vector<FaultSet>> groups;
  for (auto& [signature, sets] : by_signature) {
    if (sets.size() > 1) {
      groups.push_back(std::move(sets));
    }
  }
  std::sort(groups.begin(), groups.end(), [](const auto& a, const auto& b) {
    return std::pair(a.front().size(), a.front()) < std::pair(b.front().size(), b.front());
  });
  return groups;
}

ResidualChoice smallest_structure(const Structure& structure, std::size_t fault_count,
                                  std::size_t concurrent) {
  // Residuals that see few faults do best together, but greed alone does not begin with them.
  std::vector<std::size_t> starts;
  std::size_t most_ignored = 0;
  for (std::size_t i = 0; i < structure.size(); ++i) {
    const auto ignored = static_cast<std::size_t>(
        std::count(structure[i].begin(), structure[i].end(), Sensitivity::kNone));
    if (ignored > most_ignored) {
      most_ignored = ignored;
      starts.push_back(i);
    }
  }
  return SmallestHittingSet(needed_residuals(structure, fault_count, concurrent), structure.size())
      .run(starts);
}

}  // namespace faultline

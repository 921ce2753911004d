#include "diagnosis/runtime/decision.h"

#include <algorithm>
#include <cassert>

namespace faultline {
namespace {

constexpr std::size_t kBitsPerWord = 64;

// All sets of `size` of the faults 0..count-1, lexicographic.
void append_sets(std::size_t count, std::size_t size, std::vector<std::vector<std::size_t>>& sets) {
  std::vector<std::size_t> set(size);
  for (std::size_t i = 0; i < size; ++i) {
    set[i] = i;
  }
  while (true) {
    sets.push_back(set);
    std::size_t i = size;
    while (i > 0 && set[i - 1] == count - size + i - 1) {
      --i;
    }
    if (i == 0) {
      return;
    }
    ++set[i - 1];
    for (; i < size; ++i) {
      set[i] = set[i - 1] + 1;
    }
  }
}

struct Prediction {
  bool sees = false;       // a member
  bool must_fire = false;  // sees exactly one member, at DC
};

Prediction predict(const ResidualFilter& filter, const std::vector<std::size_t>& set) {
  std::size_t seen = 0;
  bool is_steady = false;
  for (const std::size_t j : set) {
    if (filter.sees[j] != Sensitivity::kNone) {
      ++seen;
      is_steady = filter.sees[j] == Sensitivity::kSteady;
    }
  }
  return {seen > 0, seen == 1 && is_steady};
}

}  // namespace

std::string_view verdict_name(Verdict verdict) noexcept {
  switch (verdict) {
    case Verdict::kHealthy:
      return "healthy";
    case Verdict::kIsolated:
      return "isolated";
    case Verdict::kAmbiguous:
      return "ambiguous";
    case Verdict::kUnexplained:
      return "unexplained";
    case Verdict::kInhibited:
      break;
  }
  return "inhibited";
}

DecisionTable::DecisionTable(const Bank& bank)
    : word_count_((bank.filters.size() + kBitsPerWord - 1) / kBitsPerWord) {
  const std::size_t fault_count = bank.fault_names.size();
  for (std::size_t size = 0; size <= std::min(bank.concurrent, fault_count); ++size) {
    append_sets(fault_count, size, sets_);
  }
  sees_.resize(sets_.size() * word_count_);
  must_fire_.resize(sets_.size() * word_count_);
  for (std::size_t s = 0; s < sets_.size(); ++s) {
    for (std::size_t i = 0; i < bank.filters.size(); ++i) {
      const Prediction prediction = predict(bank.filters[i], sets_[s]);
      const std::size_t word = s * word_count_ + i / kBitsPerWord;
      const std::uint64_t bit = std::uint64_t{1} << (i % kBitsPerWord);
      sees_[word] |= prediction.sees ? bit : 0;
      must_fire_[word] |= prediction.must_fire ? bit : 0;
    }
  }
}

bool DecisionTable::explains(std::size_t set,
                             std::span<const std::uint64_t> signature) const noexcept {
  for (std::size_t w = 0; w < word_count_; ++w) {
    const std::uint64_t fired_unseen = signature[w] & ~sees_[set * word_count_ + w];
    const std::uint64_t silent_unexcused = must_fire_[set * word_count_ + w] & ~signature[w];
    if ((fired_unseen | silent_unexcused) != 0) {
      return false;
    }
  }
  return true;
}

Decision DecisionTable::decide(std::span<const std::uint64_t> signature) const noexcept {
  assert(signature.size() == word_count_);
  Decision decision;
  decision.verdict = Verdict::kUnexplained;
  std::size_t smallest = 0;
  for (std::size_t s = 0; s < sets_.size(); ++s) {
    if (decision.set_count > 0 && sets_[s].size() > smallest) {
      break;
    }
    if (!explains(s, signature)) {
      continue;
    }
    smallest = sets_[s].size();
    if (decision.set_count < Decision::kMaxListed) {
      decision.sets[decision.set_count] = static_cast<std::uint32_t>(s);
    }
    ++decision.set_count;
  }
  if (decision.set_count > 1) {
    decision.verdict = Verdict::kAmbiguous;
  } else if (decision.set_count == 1) {
    decision.verdict = smallest == 0 ? Verdict::kHealthy : Verdict::kIsolated;
  }
  return decision;
}

Settling::Settling(std::uint32_t settle, std::size_t signature_words)
    : settle_(std::max<std::uint32_t>(settle, 1)), last_signature_(signature_words) {}

const Decision& Settling::step(const Decision& decision,
                               std::span<const std::uint64_t> signature) noexcept {
  assert(signature.size() == last_signature_.size());
  if (decision.verdict == Verdict::kInhibited) {
    reset();
    return announced_;
  }
  if (stood_for_ > 0 && std::equal(signature.begin(), signature.end(), last_signature_.begin())) {
    stood_for_ = std::min(stood_for_ + 1, settle_);
  } else {
    std::copy(signature.begin(), signature.end(), last_signature_.begin());
    stood_for_ = 1;
  }
  if (stood_for_ == settle_) {
    announced_ = decision;
  }
  return announced_;
}

void Settling::reset() noexcept {
  stood_for_ = 0;
  announced_ = Decision();
}

}  // namespace faultline

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

std::string_view cause_name(Cause cause) noexcept {
  switch (cause) {
    case Cause::kComplete:
      return "complete";
    case Cause::kCancellation:
      return "cancellation";
    case Cause::kTransient:
      return "transient";
    case Cause::kPartial:
      return "partial";
    case Cause::kMoreThanP:
      return "more_than_p";
    case Cause::kNone:
      break;
  }
  return "none";
}

bool is_same_verdict(const Decision& a, const Decision& b) noexcept {
  return a.verdict == b.verdict && a.set_count == b.set_count && a.sets == b.sets;
}

DecisionTable::DecisionTable(const Bank& bank)
    : word_count_((bank.filters.size() + kBitsPerWord - 1) / kBitsPerWord) {
  const std::size_t fault_count = bank.fault_names.size();
  for (std::size_t size = 0; size <= std::min(bank.concurrent, fault_count); ++size) {
    append_sets(fault_count, size, sets_);
  }
  steady_.resize(fault_count * word_count_);
  for (std::size_t j = 0; j < fault_count; ++j) {
    for (std::size_t i = 0; i < bank.filters.size(); ++i) {
      const bool is_steady = bank.filters[i].sees[j] == Sensitivity::kSteady;
      steady_[j * word_count_ + i / kBitsPerWord] |= std::uint64_t{is_steady} << (i % kBitsPerWord);
    }
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

DecisionTable::Fit DecisionTable::fit(std::size_t set, std::span<const std::uint64_t> signature,
                                      std::span<const std::uint64_t> persistent) const noexcept {
  std::uint64_t silent_unexcused = 0;
  for (std::size_t w = 0; w < word_count_; ++w) {
    if ((signature[w] & ~sees_[set * word_count_ + w]) != 0) {
      return Fit::kNone;
    }
    if (!persistent.empty() && persistent[w] != 0 && (persistent[w] & ~steady_word(set, w)) != 0) {
      return Fit::kNone;
    }
    silent_unexcused |= must_fire_[set * word_count_ + w] & ~signature[w];
  }
  return silent_unexcused == 0 ? Fit::kExplains : Fit::kCovers;
}

std::uint64_t DecisionTable::steady_word(std::size_t set, std::size_t w) const noexcept {
  std::uint64_t steady = 0;
  for (const std::size_t j : sets_[set]) {
    steady |= steady_[j * word_count_ + w];
  }
  return steady;
}

Cause DecisionTable::excuse(std::size_t set,
                            std::span<const std::uint64_t> signature) const noexcept {
  bool has_transient = false;
  for (std::size_t w = 0; w < word_count_; ++w) {
    const std::uint64_t silent = sees_[set * word_count_ + w] & ~signature[w];
    if ((silent & steady_word(set, w)) != 0) {
      return Cause::kCancellation;
    }
    has_transient = has_transient || silent != 0;
  }
  return has_transient ? Cause::kTransient : Cause::kComplete;
}

Decision DecisionTable::decide(std::span<const std::uint64_t> signature,
                               std::span<const std::uint64_t> persistent) const noexcept {
  assert(signature.size() == word_count_);
  assert(persistent.empty() || persistent.size() == word_count_);
  Decision explaining, covering;
  std::size_t explaining_size = 0, covering_size = 0;
  const auto list = [](Decision& decision, std::size_t s) {
    if (decision.set_count < Decision::kMaxListed) {
      decision.sets[decision.set_count] = static_cast<std::uint32_t>(s);
    }
    ++decision.set_count;
  };
  for (std::size_t s = 0; s < sets_.size(); ++s) {
    if (explaining.set_count > 0 && sets_[s].size() > explaining_size) {
      break;
    }
    const Fit found = fit(s, signature, persistent);
    if (found == Fit::kExplains) {
      explaining_size = sets_[s].size();
      list(explaining, s);
    } else if (found == Fit::kCovers &&
               (covering.set_count == 0 || sets_[s].size() == covering_size)) {
      covering_size = sets_[s].size();
      list(covering, s);
    }
  }
  if (explaining.set_count == 0) {
    covering.verdict = Verdict::kUnexplained;
    covering.cause = covering.set_count > 0 ? Cause::kPartial : Cause::kMoreThanP;
    return covering;
  }
  if (explaining_size == 0) {
    explaining.verdict = Verdict::kHealthy;
    return explaining;
  }
  explaining.verdict = explaining.set_count > 1 ? Verdict::kAmbiguous : Verdict::kIsolated;
  explaining.cause = Cause::kComplete;
  const std::size_t listed = std::min<std::size_t>(explaining.set_count, Decision::kMaxListed);
  for (std::size_t i = 0; i < listed && explaining.cause != Cause::kCancellation; ++i) {
    const Cause granted = excuse(explaining.sets[i], signature);
    explaining.cause = granted == Cause::kComplete ? explaining.cause : granted;
  }
  return explaining;
}

Settling::Settling(const DecisionRule& rule, std::size_t signature_words)
    : settle_(std::max<std::uint32_t>(rule.settle, 1)),
      clearing_(std::max(settle_, rule.clearing)),
      last_signature_(signature_words),
      announced_signature_(signature_words) {}

bool Settling::is_remainder(const Decision& decision,
                            std::span<const std::uint64_t> signature) const noexcept {
  if (decision.verdict == Verdict::kHealthy || announced_.set_count == 0 ||
      announced_.verdict == Verdict::kHealthy) {
    return false;
  }
  for (std::size_t w = 0; w < signature.size(); ++w) {
    if ((signature[w] & ~announced_signature_[w]) != 0) return false;
  }
  const auto listed = [](const Decision& of) {
    return std::span(of.sets).first(std::min<std::size_t>(of.set_count, Decision::kMaxListed));
  };
  const auto known = listed(announced_);
  return std::none_of(listed(decision).begin(), listed(decision).end(), [&](std::uint32_t set) {
    return std::find(known.begin(), known.end(), set) != known.end();
  });
}

const Decision& Settling::step(const Decision& decision,
                               std::span<const std::uint64_t> signature) noexcept {
  assert(signature.size() == last_signature_.size());
  if (decision.verdict == Verdict::kInhibited) {
    reset();
    return announced_;
  }
  if (stood_for_ > 0 && decision == last_decision_ &&
      std::equal(signature.begin(), signature.end(), last_signature_.begin())) {
    stood_for_ = std::min(stood_for_ + 1, clearing_);
  } else {
    std::copy(signature.begin(), signature.end(), last_signature_.begin());
    last_decision_ = decision;
    stood_for_ = 1;
  }
  has_settled_ = stood_for_ >= (is_remainder(decision, signature) ? clearing_ : settle_);
  if (has_settled_) {
    announced_ = decision;
    std::copy(signature.begin(), signature.end(), announced_signature_.begin());
  }
  return announced_;
}

void Settling::reset() noexcept {
  stood_for_ = 0;
  has_settled_ = false;
  announced_ = Decision();
  std::fill(announced_signature_.begin(), announced_signature_.end(), 0);
}

}  // namespace faultline

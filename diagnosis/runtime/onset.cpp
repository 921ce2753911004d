#include "diagnosis/runtime/onset.h"

#include <algorithm>
#include <cassert>

namespace faultline {
namespace {

constexpr std::size_t kBitsPerWord = 64;
constexpr Onset kNoOnset;

Decision healthy() {
  Decision decision;
  decision.verdict = Verdict::kHealthy;
  decision.set_count = 1;  // the empty set explains that nothing fired
  return decision;
}

// True if `decision` lists fewer of the sets that the ambiguous `before` lists; where one has more
// sets than it lists, that cannot be told.
bool narrows(const Decision& decision, const Decision& before) noexcept {
  if (before.verdict != Verdict::kAmbiguous || before.set_count > Decision::kMaxListed ||
      decision.set_count >= before.set_count ||
      (decision.verdict != Verdict::kIsolated && decision.verdict != Verdict::kAmbiguous)) {
    return false;
  }
  const auto end = before.sets.begin() + before.set_count;
  return std::all_of(
      decision.sets.begin(), decision.sets.begin() + decision.set_count,
      [&](std::uint32_t set) { return std::find(before.sets.begin(), end, set) != end; });
}

}  // namespace

OnsetTracker::OnsetTracker(std::size_t signature_words)
    : decision_(healthy()), reference_(healthy()), reference_signature_(signature_words) {}

const Onset& OnsetTracker::step(const Settling& settling, const Evaluator& evaluator,
                                std::uint32_t cycle) noexcept {
  assert(evaluator.signature().size() == reference_signature_.size());
  const Decision& announced = settling.announced();
  if (announced.verdict == Verdict::kInhibited) {
    return kNoOnset;
  }
  if (!settling.has_settled()) {
    return onset_;
  }
  if (!is_same_verdict(announced, decision_)) {
    decision_ = announced;
    onset_ = find(evaluator, cycle);
  }
  if (announced.verdict != Verdict::kUnexplained) {
    reference_ = announced;
    reference_onset_ = onset_;
    std::copy(evaluator.signature().begin(), evaluator.signature().end(),
              reference_signature_.begin());
  }
  return onset_;
}

Onset OnsetTracker::find(const Evaluator& evaluator, std::uint32_t cycle) const noexcept {
  std::uint64_t oldest_age = 0;
  std::uint64_t youngest_age = evaluator.crossing_age(0);
  Onset onset;
  for (std::size_t i = 0; i < evaluator.fired().size(); ++i) {
    const std::uint64_t age = evaluator.crossing_age(i);
    youngest_age = std::min(youngest_age, age);
    const std::size_t w = i / kBitsPerWord;
    const std::uint64_t changed = evaluator.signature()[w] ^ reference_signature_[w];
    const bool has_crossed = ((changed >> (i % kBitsPerWord)) & 1) != 0;
    if (has_crossed && (onset.filter == Onset::kNone || age > oldest_age)) {
      onset.filter = static_cast<std::int64_t>(i);
      oldest_age = age;
    }
  }
  // Cycles wrap at 2^32, and so do these differences.
  const std::uint32_t first = cycle - static_cast<std::uint32_t>(oldest_age);
  const std::uint32_t last = cycle - static_cast<std::uint32_t>(youngest_age);
  // Where nothing has crossed, a residual has become persistent, or is not any more.
  const bool is_old = is_same_verdict(decision_, reference_) || onset.filter == Onset::kNone ||
                      narrows(decision_, reference_);
  if (is_old) {
    onset = reference_onset_;
  } else {
    onset.cycle = first;
  }
  onset.last_cycle = last;
  return onset;
}

void OnsetTracker::reset() noexcept {
  decision_ = reference_ = healthy();
  onset_ = reference_onset_ = kNoOnset;
  std::fill(reference_signature_.begin(), reference_signature_.end(), 0);
}

}  // namespace faultline

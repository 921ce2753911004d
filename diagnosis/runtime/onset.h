#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/evaluator.h"

namespace faultline {

/// The crossings that led to an announced decision.
struct Onset {
  static constexpr std::int64_t kNone = -1;
  /// Cycle at which the first of them began: of the run of `dwell` samples that made a residual
  /// fire, or clear, its first. kNone: nothing crossed (inhibited; healthy from the start).
  std::int64_t cycle = kNone;
  /// Index of that residual (the first, if several began at once).
  std::int64_t filter = kNone;
  /// Cycle at which the last crossing of any residual before the announcement began: the faults are
  /// what they are from there on at the latest.
  std::int64_t last_cycle = kNone;
  friend bool operator==(const Onset&, const Onset&) = default;
};

/// Finds the onset of each announced decision: of the residuals that are not as they were when
/// healthy, isolated or ambiguous was last announced, when they became so. So the second of two
/// faults gets its own onset, an unexplained signature on the way to an isolated one does not take
/// the first crossing away, and a decision that returns after one has its old onset. So has the
/// same decision after an inhibition, which has none itself. A decision that leaves fewer of the
/// sets of an ambiguous one, because a residual has cleared or become persistent, has the onset of
/// that: the fault is the same, only more is known of it. Real-time: allocates only on
/// construction.
class OnsetTracker {
 public:
  explicit OnsetTracker(std::size_t signature_words);

  /// Takes what was announced after this sample; `evaluator` has taken the sample of `cycle`.
  /// @return the onset of the announced decision; valid until the next call.
  const Onset& step(const Settling& settling, const Evaluator& evaluator,
                    std::uint32_t cycle) noexcept;
  /// Nothing has crossed.
  void reset() noexcept;

 private:
  [[nodiscard]] Onset find(const Evaluator& evaluator, std::uint32_t cycle) const noexcept;

  Decision decision_;  // the last announced one that was not inhibited
  Onset onset_;
  Decision reference_;  // the last announced one that was healthy, isolated or ambiguous
  Onset reference_onset_;
  std::vector<std::uint64_t> reference_signature_;
};

}  // namespace faultline

#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "diagnosis/bank/bank.h"

namespace faultline {

enum class Verdict : std::uint8_t {
  kHealthy,      ///< nothing fired
  kIsolated,     ///< one smallest fault set explains the fired residuals
  kAmbiguous,    ///< several smallest sets do
  kUnexplained,  ///< no set of up to p faults does: a partial signature, or more than p faults
  kInhibited,    ///< samples bad or residuals contaminated: no statement
};
[[nodiscard]] std::string_view verdict_name(Verdict verdict) noexcept;  ///< "healthy", ...

/// Why a verdict is what it is: what had to be granted to the sets it lists, or what kept every set
/// from explaining the fired residuals.
enum class Cause : std::uint8_t {
  kNone,          ///< healthy or inhibited: there is nothing to say
  kComplete,      ///< every residual that sees a member of a listed set has fired
  kCancellation,  ///< a silent one sees two or more members of a listed set: they may cancel
  kTransient,     ///< a silent one sees members of a listed set, but only in transients
  kPartial,       ///< unexplained: the listed sets would, but for silent residuals that must fire:
                  ///< their faults are below a threshold
  kMoreThanP,     ///< unexplained: no set of up to p faults is seen by every fired residual
};
/// "none", "complete", "cancellation", "transient", "partial", "more_than_p".
[[nodiscard]] std::string_view cause_name(Cause cause) noexcept;

/// What one signature says. Sets are indices into DecisionTable::sets().
struct Decision {
  static constexpr std::size_t kMaxListed = 8;
  Verdict verdict = Verdict::kInhibited;
  Cause cause = Cause::kNone;
  /// Smallest explaining sets; of a partial signature the smallest that could have left it. The
  /// first kMaxListed are listed.
  std::uint32_t set_count = 0;
  std::array<std::uint32_t, kMaxListed> sets{};
  friend bool operator==(const Decision&, const Decision&) = default;
};

/// True if both name the same verdict and the same sets, for whatever cause.
[[nodiscard]] bool is_same_verdict(const Decision& a, const Decision& b) noexcept;

/// All fault sets of up to p faults and what each predicts of every residual. Immutable.
///
/// A set explains the fired residuals iff every fired one sees a member of it, and every silent one
/// sees none of them, or two or more (they may cancel), or one only in transients. Where a listed
/// set needs both excuses, or one needs one and another the other, the cause is cancellation.
///
/// A persistent one (Evaluator::persistent()) fires longer than a fault makes it that it sees only
/// in transients: it must see a member at DC. So an alarm that stays says "a fault that is seen at
/// DC", and one that goes again, while another residual stays, "one that is seen in transients".
class DecisionTable {
 public:
  explicit DecisionTable(const Bank& bank);

  /// Fault sets (indices into Bank::fault_names), by size, then lexicographic; the first is empty.
  [[nodiscard]] const std::vector<std::vector<std::size_t>>& sets() const noexcept { return sets_; }

  /// The verdict of a signature (Evaluator::signature()) of which some residuals, a subset, are
  /// persistent; an empty span: none is. Has no memory. Real-time.
  [[nodiscard]] Decision decide(std::span<const std::uint64_t> signature,
                                std::span<const std::uint64_t> persistent = {}) const noexcept;

 private:
  enum class Fit { kNone, kCovers, kExplains };
  // Explains; or at least covers: every fired residual sees a member, a persistent one at DC.
  [[nodiscard]] Fit fit(std::size_t set, std::span<const std::uint64_t> signature,
                        std::span<const std::uint64_t> persistent) const noexcept;
  // Residuals that see a member at DC, of word w.
  [[nodiscard]] std::uint64_t steady_word(std::size_t set, std::size_t w) const noexcept;
  [[nodiscard]] Cause excuse(std::size_t set,
                             std::span<const std::uint64_t> signature) const noexcept;

  std::size_t word_count_;
  std::vector<std::vector<std::size_t>> sets_;
  std::vector<std::uint64_t> sees_;       // sets × words: residuals that see a member
  std::vector<std::uint64_t> must_fire_;  // sets × words: see exactly one member, at DC
  std::vector<std::uint64_t> steady_;     // faults × words: residuals that see it at DC
};

/// Announces a decision once it and its signature have stood for `settle` samples; keeps the last
/// announced one until then. (What one signature says changes when a residual becomes persistent.)
/// Inhibition is announced at once, and before the first decision.
///
/// A fault does not turn into another one: where residuals have only cleared since the last
/// announcement and none of its fault sets explains the rest, the rest must stand for `clearing`
/// samples, in which slower residuals clear, too. Real-time.
class Settling {
 public:
  Settling(const DecisionRule& rule, std::size_t signature_words);
  /// @return the announced decision after this sample.
  const Decision& step(const Decision& decision, std::span<const std::uint64_t> signature) noexcept;
  void reset() noexcept;
  [[nodiscard]] const Decision& announced() const noexcept { return announced_; }
  /// True if decision and signature of the last step have stood: they are what is announced.
  [[nodiscard]] bool has_settled() const noexcept { return has_settled_; }

 private:
  // Residuals have only cleared since the last announcement, and yet other faults explain them.
  [[nodiscard]] bool is_remainder(const Decision& decision,
                                  std::span<const std::uint64_t> signature) const noexcept;

  std::uint32_t settle_;
  std::uint32_t clearing_;
  std::uint32_t stood_for_ = 0;
  bool has_settled_ = false;
  std::vector<std::uint64_t> last_signature_;
  std::vector<std::uint64_t> announced_signature_;
  Decision last_decision_;
  Decision announced_;
};

}  // namespace faultline

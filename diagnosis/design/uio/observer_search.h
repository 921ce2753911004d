#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/design/uio/observer_synthesis.h"

namespace faultline {

/// Where the reference system e' = a_0 e - V m has V from: V = -v times
enum class ReferenceDirection {
  /// F_x. Best where the residual sees the fault within one sample (R F_x has full column rank);
  /// elsewhere the reference is blind, and with it the inequality without solution.
  kFaultInput,
  /// How the L∞ observer's error answers the fault in the middle of the band:
  /// (e^jθ I - N)⁻¹ F_e, each column turned to its largest real part.
  kFaultResponse,
};

/// The multipliers of one attempt; the inequalities are linear once they are fixed.
struct ObserverMultipliers {
  double alpha = 0.9;
  ReferenceDirection direction = ReferenceDirection::kFaultInput;
  double a_0 = -0.05;
  double v = 0.0;
};

/// What is tried. The defaults found the best known observers of the flexible-joint robot (n = 4,
/// 5) to within 1 %.
struct ObserverSearchOptions {
  std::vector<double> alphas = {0.7, 0.8, 0.9, 0.95};
  std::vector<double> a_0s = {-0.05, 0.5, 0.9};
  /// v is sought here, in logarithmic steps: dimensionless, "how many samples' worth of the fault".
  double smallest_v = 0.1;
  double largest_v = 300.0;
  ResidualWeight weight = ResidualWeight::kScalar;
  /// Called after each attempt with how many there were so far.
  std::function<void(std::size_t)> on_attempt{};
};

struct ObserverAttempt {
  ObserverMultipliers multipliers;
  SynthesisStatus status = SynthesisStatus::kInaccurate;
  std::string reason;      ///< if not solved
  double objective = 0.0;  ///< J_th/β if solved; L∞ only: J_th
};

struct ObserverCandidate {
  ObserverMultipliers multipliers;
  ObserverSynthesis design;  ///< as synthesised
  /// The same gain and weight with the smallest J_th at its α; `design`'s own bound where that
  /// could not be computed.
  ObserverSynthesis bound;
};

struct ObserverSearch {
  std::vector<ObserverCandidate> candidates;  ///< the best of each (α, a_0) that has any
  std::vector<ObserverAttempt> attempts;      ///< all, in their order
};

/// Searches the multipliers of H-/L∞ synthesis for small J_th/β. It has, over log v, one minimum by
/// experience, flat enough for steps of √3: descent along v for every α and a_0, from where
/// the last one ended; both directions are tried first at one α and a_0, and the better one is
/// kept. Which candidate is best the caller decides: the smallest fault that is found by the bounds
/// it uses is another measure.
/// @param band absent: L∞ only, one attempt per α
/// @throws std::invalid_argument as synthesise_observer does; if a list is empty or the range of v
/// is Cost: some 60 programs for the default lists.
[[nodiscard]] ObserverSearch search_observer(const ObserverModel& model,
                                             const DecouplingMatrices& decoupling,
                                             const ObserverOutput& output,
                                             const std::optional<FrequencyBand>& band,
                                             const ObserverSearchOptions& options = {});

}  // namespace faultline

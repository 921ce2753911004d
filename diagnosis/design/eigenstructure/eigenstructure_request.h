#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace faultline {

/// How unknown inputs are kept out of a residual.
enum class AssignmentChoice {
  kBest,       ///< the first of those below that sees all that any residual can see
  kLeft,       ///< rows of W C are left eigenvectors of A - K C
  kRight,      ///< the unknown inputs' directions are right eigenvectors of A - K C
  kGeometric,  ///< the quotient by the smallest unobservability subspace
};

/// What a residual that unknown inputs cannot be kept out of is chosen by.
enum class CompromiseCriterion {
  kLowRank,    ///< min ‖CE - (CE)*‖_F, W (CE)* = 0: smallest singular values removed
  kStatic,     ///< min ‖H E‖ / ‖H‖, H = W C: criterion (13) of Jin and Zhang, exactly
  kWorstCase,  ///< largest gain over frequency, to the smallest gain of a wanted fault
  kRms,        ///< rms of the residual under white unknown inputs, to the same
};

/// [eigenstructure] of bank.toml.
struct EigenstructureRequest {
  AssignmentChoice assignment = AssignmentChoice::kBest;
  /// Names of disturbances to be kept as small as can be in residuals that cannot be without them.
  std::vector<std::string> weaken;
  CompromiseCriterion criterion = CompromiseCriterion::kWorstCase;
  /// Rows of residuals that are a compromise; absent: the fewest that come within 5 % of the best.
  std::optional<std::uint32_t> rows;
};

}  // namespace faultline

#pragma once

#include <complex>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/uio/observer_model.h"
#include "diagnosis/design/uio/observer_synthesis.h"

namespace faultline {

/// A mode of S (A + Λ) on or outside the unit circle that no gain moves:
/// rank [λI - S(A + Λ); C] < n.
struct FixedMode {
  std::complex<double> lambda;
  Eigen::Index vertex = -1;  ///< of Λ; -1: the middle of the slopes
};

/// The first such mode of the middle or of a vertex; none: every one of them, alone, can be made
/// stable.
[[nodiscard]] std::optional<FixedMode> fixed_mode(const ObserverModel& model,
                                                  const DecouplingMatrices& decoupling);

/// A fault signal at one frequency that leaves y - ŷ at zero for every gain Γ:
///
///   (zI - S A) e = (S F_x - z T F_y) m,   C e + F_y m = 0,   z = e^{iθ}
struct HiddenFault {
  double angle_rad = 0.0;
  Eigen::VectorXcd m;  ///< f; the largest entry is 1
  Eigen::VectorXcd e;  ///< n: the error it makes instead
};

/// The first angle of the band at which there is one: H- is zero there, and the inequalities are
/// infeasible whatever the multipliers. Looked for at both ends of the band and 31 angles between.
[[nodiscard]] std::optional<HiddenFault> hidden_fault(const ObserverModel& model,
                                                      const DecouplingMatrices& decoupling,
                                                      const FrequencyBand& band);

}  // namespace faultline

#pragma once

#include <string>
#include <vector>

#include "diagnosis/design/uio/observer_search.h"

namespace faultline {

/// One way in which an observer was tried: what it decouples, and how fast it is to be.
struct ObserverTrial {
  std::vector<std::string> decoupled;  ///< names of the disturbances that do not reach its error
  double alpha = 0.0;                  ///< 0: refused before any
  SynthesisStatus status = SynthesisStatus::kInaccurate;
  std::string reason;               ///< if there is none: why
  ObserverMultipliers multipliers;  ///< H-: the best ones
  double objective = 0.0;           ///< J_th/β of the inequalities; without H-: J_th
  double beta = 0.0;                ///< certified; 0 without H-
  double j_th = 0.0;                ///< of the gain alone, analysed again
  std::vector<double> radius;       ///< ρ at the vertices of the slopes
  Eigen::VectorXd component;        ///< limit of the componentwise threshold, per row
  /// Smallest constant fault of those to be detected that is detected for sure, the worst of them,
  /// in fault sizes; of an estimator the bound of its estimates. 0: there is none.
  double guaranteed = 0.0;
  bool is_chosen = false;
};

/// What became of an observer that was asked for.
struct ObserverReport {
  std::string name;
  std::vector<ObserverTrial> trials;
  bool exists = false;
};

}  // namespace faultline

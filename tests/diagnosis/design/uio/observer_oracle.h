#pragma once

#include <string>

#include <Eigen/Core>

#include "diagnosis/design/uio/observer_synthesis.h"

namespace faultline {

/// A case of tests/golden/uio/uio_cases.json.
struct ObserverOracle {
  ObserverModel model;  ///< w: the disturbances, then the noise
  DecouplingMatrices decoupling;
  ObserverOutput output;
  double alpha = 0.0;
  FrequencyBand band;
  ReferenceSystem reference;  ///< V empty: the case has none
  double objective = 0.0;     ///< 0: the case has none
  Eigen::MatrixXd gain;       ///< empty: infeasible
  Eigen::VectorXd beta;       ///< H- index per vertex
  double J_th = 0.0;          ///< of the re-analysed gain; 0: the case has none
};
[[nodiscard]] ObserverOracle observer_oracle(const std::string& name);

}  // namespace faultline

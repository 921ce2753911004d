#pragma once

#include <string>
#include <vector>

namespace faultline {

/// Which disturbance directions an observer keeps out by structure (S D_1 = 0).
enum class DecouplingChoice {
  kBest,  ///< all that can be, and only those that must be: the better of the two
  kFull,  ///< all that can be
  kNone,  ///< only those that must be (`decouple`)
};

/// One observer that is asked for.
struct ObserverRequest {
  std::vector<std::string> carry;  ///< faults that it carries as states: their sizes are estimated
  double drift_per_s = 0.0;        ///< largest rate of change of those that its design reckons with
  std::vector<double> alpha{0.7, 0.8, 0.9, 0.95};  ///< decay per sample of the quadratic bound
  DecouplingChoice decoupling = DecouplingChoice::kBest;
};

/// [uio] of bank.toml.
struct UioRequest {
  /// Faults whose smallest gain over the band is to be large; empty: all but the sensors'.
  std::vector<std::string> detect;
  bool is_h_minus = true;                          ///< false: noise and disturbances only (L∞)
  double band_low_rad = 0.0, band_high_rad = 0.1;  ///< per sample
  bool is_weight_full = false;  ///< of the residual's rows; else they count alike
  /// Multipliers of the H- inequality to be tried, V = -v F_x; empty: a search.
  std::vector<double> a_0, v;
  ObserverRequest detection;
  ObserverRequest estimation;           ///< of the faults it carries; none: no estimator
  bool is_threshold_quadratic = false;  ///< else componentwise
};

}  // namespace faultline

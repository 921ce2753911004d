#pragma once

#include <vector>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// Two observers of one plant, made by hand:
///
///   x1_k+1 = 0.8 x1 + 0.1 x2 + 0.05 sin x2 + u + f_u    y1 = x1 + f_y1
///   x2_k+1 = 0.2 x1 + 0.7 x2                            y2 = x2
///
/// Both carry f_y1 as a state, v = (x̂; f̂_y1), T = 0:
///
/// | filter | residual | evaluation, threshold | sees u | sees y1 |
/// |---|---|---|---|---|
/// | detection | y - ŷ | component, r̄(k) | at DC | in transients |
/// | estimate | f̂_y1 | norm, J(k) | at DC | at DC, with gain 1 |
///
/// Its equations are exact, its thresholds not proved; there are no disturbances.
[[nodiscard]] Bank observer_bank();

/// The plant of that bank, from x = 0.
class ObservedPlant {
 public:
  [[nodiscard]] std::vector<double> y() const { return {x1_ + f_y1, x2_}; }
  void step(double u);

  double f_u = 0.0, f_y1 = 0.0;

 private:
  double x1_ = 0.0, x2_ = 0.0;
};

}  // namespace faultline

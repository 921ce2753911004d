#include "sim/plants/flexible_joint.h"

#include <cmath>

namespace faultline {

void FlexibleJoint::derivative(const double* x, const double* u, const double* /*p*/,
                               const double* d, double* dx) {
  dx[0] = x[1] - 0.2 * d[0] + 0.01 * d[1] - 0.02 * d[2];
  dx[1] = -48.6 * x[0] - 1.25 * x[1] + 48.6 * x[2] + 21.6 * u[0] - 0.1 * d[0] + 0.02 * d[1] -
          0.04 * d[2];
  dx[2] = 10.0 * x[3] + 0.1 * d[0] - 0.02 * d[1] + 0.04 * d[2];
  dx[3] =
      1.95 * x[0] - 1.95 * x[2] - 0.333 * std::sin(x[2]) + 0.2 * d[0] + 0.02 * d[1] - 0.04 * d[2];
}

void FlexibleJoint::measure(const double* x, const double* /*u*/, const double* /*p*/,
                            const double* /*d*/, double* y) {
  y[0] = x[0];
  y[1] = x[1];
  y[2] = x[2] + x[3];
}

}  // namespace faultline

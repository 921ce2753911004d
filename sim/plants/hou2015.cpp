#include "sim/plants/hou2015.h"

namespace faultline {

void Hou2015::derivative(const double* x, const double* u, const double* /*p*/, const double* /*d*/,
                         double* dx) {
  dx[0] = x[0] + x[1] + x[2] + u[0] + u[2] + u[3];
  dx[1] = -x[1] + 2.0 * x[2] + u[1] + u[2];
  dx[2] = 2.0 * x[0] - 4.0 * x[2] + u[1] + u[3];
}

void Hou2015::measure(const double* x, const double* /*u*/, const double* /*p*/,
                      const double* /*d*/, double* y) {
  y[0] = x[1];
  y[1] = x[2];
  y[2] = x[0] + 2.0 * x[2];
}

}  // namespace faultline

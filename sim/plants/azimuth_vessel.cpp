#include "sim/plants/azimuth_vessel.h"

#include <cmath>

namespace faultline {
namespace {

using V = AzimuthVessel;

// M = [m11 0 0; 0 m22 m23; 0 m23 m33], with Y_rdot = N_vdot = 0.
constexpr double m11 = V::kMass_kg - V::kX_udot;
constexpr double m22 = V::kMass_kg - V::kY_vdot;
constexpr double m23 = V::kMass_kg * V::kCentre_m;
constexpr double m33 = V::kInertia_kg_m2 - V::kN_rdot;
constexpr double kDeterminant = m22 * m33 - m23 * m23;  // of M's lower right part
static_assert(m11 > 0.0 && m22 > 0.0 && kDeterminant > 0.0, "M must be positive definite");

V::Vector3 thrusters(const double* u) noexcept {
  V::Vector3 tau{};
  for (std::size_t i = 0; i < V::kThrusters; ++i) {
    const double X = u[i] * std::cos(u[V::kThrusters + i]);
    const double Y = u[i] * std::sin(u[V::kThrusters + i]);
    tau[0] += X;
    tau[1] += Y;
    tau[2] += V::kThruster_x_m[i] * Y - V::kThruster_y_m[i] * X;
  }
  return tau;
}

}  // namespace

V::Vector3 AzimuthVessel::coriolis(const Vector3& nu) noexcept {
  const double c13 = -m22 * nu[1] - m23 * nu[2];
  const double c23 = m11 * nu[0];
  return {c13 * nu[2], c23 * nu[2], -c13 * nu[0] - c23 * nu[1]};
}

V::Vector3 AzimuthVessel::damping(const Vector3& nu) noexcept {
  return {(-kX_u - kX_uu * std::abs(nu[0])) * nu[0], (-kY_v - kY_vv * std::abs(nu[1])) * nu[1],
          (-kN_r - kN_rr * std::abs(nu[2])) * nu[2]};
}

double AzimuthVessel::energy_J(const Vector3& nu) noexcept {
  return 0.5 * (m11 * nu[0] * nu[0] + m22 * nu[1] * nu[1] + m33 * nu[2] * nu[2]) +
         m23 * nu[1] * nu[2];
}

void AzimuthVessel::derivative(const double* x, const double* u, const double* /*p*/,
                               const double* d, double* dx) {
  const Vector3 nu{x[3], x[4], x[5]};
  const Vector3 coriolis_force = coriolis(nu);
  const Vector3 damping_force = damping(nu);
  Vector3 force = thrusters(u);
  for (std::size_t i = 0; i < force.size(); ++i) {
    force[i] += d[i] - coriolis_force[i] - damping_force[i];
  }
  const double c = std::cos(x[2]);
  const double s = std::sin(x[2]);
  dx[0] = c * nu[0] - s * nu[1];
  dx[1] = s * nu[0] + c * nu[1];
  dx[2] = nu[2];
  dx[3] = force[0] / m11;
  dx[4] = (m33 * force[1] - m23 * force[2]) / kDeterminant;
  dx[5] = (m22 * force[2] - m23 * force[1]) / kDeterminant;
}

void AzimuthVessel::measure(const double* x, const double* /*u*/, const double* /*p*/,
                            const double* d, double* y) {
  for (std::size_t i = 0; i < std::size(outputs); ++i) y[i] = x[i] + d[3 + i];
}

}  // namespace faultline

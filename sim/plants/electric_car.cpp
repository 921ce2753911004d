#include "sim/plants/electric_car.h"

#include <algorithm>
#include <cmath>

namespace faultline {
namespace {

using Car = ElectricCar;

constexpr double kWheelBase_m = Car::kFront_m + Car::kRear_m;
constexpr double kWeight_N = Car::kMass_kg * Car::kGravity_m_s2;
// Static: no transfer of load.
constexpr double kFrontLoad_N = kWeight_N * Car::kRear_m / kWheelBase_m / 2.0;
constexpr double kRearLoad_N = kWeight_N * Car::kFront_m / kWheelBase_m / 2.0;

struct Corner {
  double x_m, y_m, load_N;
  bool is_steered;
};
constexpr Corner kCorners[Car::kWheels] = {
    {Car::kFront_m, Car::kTrack_m / 2.0, kFrontLoad_N, true},
    {Car::kFront_m, -Car::kTrack_m / 2.0, kFrontLoad_N, true},
    {-Car::kRear_m, Car::kTrack_m / 2.0, kRearLoad_N, false},
    {-Car::kRear_m, -Car::kTrack_m / 2.0, kRearLoad_N, false}};

// tanh(s) / s.
double saturation(double s) noexcept {
  constexpr double kSmall = 1e-4;  // below it 1 - s²/3 is exact to 1e-16
  return s < kSmall ? 1.0 - s * s / 3.0 : std::tanh(s) / s;
}

// From -1 to 1 with the sign of a speed; 1 to rounding error above ten times the least speed.
double direction(double speed_m_s) noexcept { return std::tanh(speed_m_s / Car::kLeastSpeed_m_s); }

struct BodyForce {
  double X_N = 0.0, Y_N = 0.0, N_Nm = 0.0;
};

}  // namespace

Car::TyreForce ElectricCar::tyre(double wheel_speed_rad_s, double along_m_s, double across_m_s,
                                 double load_N, double friction) noexcept {
  const double reference_m_s = std::max(std::abs(along_m_s), kLeastSpeed_m_s);
  const double along_N =
      kLongitudinal_N * (kWheelRadius_m * wheel_speed_rad_s - along_m_s) / reference_m_s;
  const double across_N = -kCornering_N * across_m_s / reference_m_s;
  const double kept = saturation(std::hypot(along_N, across_N) / (friction * load_N));
  return {kept * along_N, kept * across_N};
}

void ElectricCar::derivative(const double* x, const double* u, const double* p, const double* d,
                             double* dx) {
  const double v_x = x[0];
  const double v_y = x[1];
  const double r = x[2];
  BodyForce body;
  for (std::size_t i = 0; i < kWheels; ++i) {
    const Corner& corner = kCorners[i];
    const double c = corner.is_steered ? std::cos(u[kWheels]) : 1.0;
    const double s = corner.is_steered ? std::sin(u[kWheels]) : 0.0;
    const double forward_m_s = v_x - r * corner.y_m;
    const double left_m_s = v_y + r * corner.x_m;
    const TyreForce force = tyre(x[3 + i], c * forward_m_s + s * left_m_s,
                                 c * left_m_s - s * forward_m_s, corner.load_N, p[kWheels]);
    const double X = c * force.along_N - s * force.across_N;
    const double Y = s * force.along_N + c * force.across_N;
    body.X_N += X;
    body.Y_N += Y;
    body.N_Nm += corner.x_m * Y - corner.y_m * X;
    dx[3 + i] =
        (u[i] - p[i] * direction(kWheelRadius_m * x[3 + i]) - kWheelRadius_m * force.along_N) /
        kWheelInertia_kg_m2;
  }
  const double resistance_N =
      kAirDrag_N_s2_m2 * v_x * std::abs(v_x) + kRolling * kWeight_N * direction(v_x);
  dx[0] = (body.X_N - resistance_N) / kMass_kg - kGravity_m_s2 * d[0] + r * v_y;
  dx[1] = (body.Y_N + d[1]) / kMass_kg - r * v_x;
  dx[2] = (body.N_Nm + kWindArm_m * d[1]) / kYawInertia_kg_m2;
}

void ElectricCar::measure(const double* x, const double* /*u*/, const double* /*p*/,
                          const double* d, double* y) {
  for (std::size_t i = 0; i < std::size(outputs); ++i) y[i] = x[i] + d[2 + i];
}

}  // namespace faultline

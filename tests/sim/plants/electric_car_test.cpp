#include "sim/plants/electric_car.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "tests/sim/plants/free_plant.h"

namespace faultline {
namespace {

using Car = ElectricCar;

// At `speed_m_s`, its wheels turning a thousandth faster than they roll.
FreePlant<Car> car_at(double speed_m_s) {
  FreePlant<Car> car;
  car.x[0] = speed_m_s;
  for (std::size_t i = 3; i < 7; ++i) car.x[i] = 1.001 * speed_m_s / Car::kWheelRadius_m;
  return car;
}

// Settled at `speed_m_s` with this steering angle: the torque follows the speed.
FreePlant<Car> cornering(double speed_m_s, double steering_rad) {
  FreePlant<Car> car = car_at(speed_m_s);
  car.u[4] = steering_rad;
  constexpr double kGain_Nm_s_m = 500.0;
  for (int k = 0; k < 60'000; ++k) {
    for (std::size_t i = 0; i < 4; ++i) {
      car.u[i] = Car::kTorque_Nm + kGain_Nm_s_m * (speed_m_s - car.x[0]);
    }
    car.step(5e-4);
  }
  return car;
}

// r = v δ / (L + K v²), K = m (l_r C_r - l_f C_f) / (C_f C_r L), C of an axle (Rajamani, 3.3).
double bicycle_yaw_rate(double speed_m_s, double steering_rad) {
  const double L = Car::kFront_m + Car::kRear_m;
  const double C = 2.0 * Car::kCornering_N;
  const double K = Car::kMass_kg * (Car::kRear_m - Car::kFront_m) * C / (C * C * L);
  return speed_m_s * steering_rad / (L + K * speed_m_s * speed_m_s);
}

TEST(ElectricCar, DrivesStraightOnWithTheTorqueThatItsResistanceTakes) {
  FreePlant<Car> car;
  car.run(5.0, 5e-4);
  EXPECT_NEAR(car.x[0], 20.0, 2e-3);  // the wheels' start without slip costs them that
  const auto rate = car.derivative();
  for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(rate[i], 0.0, 1e-3) << i;
  // F = C_κ κ: a slip of a thousandth.
  const double slip = Car::kWheelRadius_m * car.x[3] / car.x[0] - 1.0;
  EXPECT_NEAR(slip, Car::kTorque_Nm / Car::kWheelRadius_m / Car::kLongitudinal_N, 1e-6);
  EXPECT_NEAR(slip, 1e-3, 1e-5);
}

TEST(ElectricCar, CornersAsTheBicycleModelSaysAtSmallAngles) {
  for (const double speed_m_s : {10.0, 20.0, 30.0}) {
    for (const double steering_rad : {0.002, -0.004}) {
      const FreePlant<Car> car = cornering(speed_m_s, steering_rad);
      const double expected = bicycle_yaw_rate(speed_m_s, steering_rad);
      EXPECT_NEAR(car.x[2] / expected, 1.0, 0.01) << speed_m_s << " m/s, " << steering_rad;
      EXPECT_NEAR(car.derivative()[2], 0.0, 1e-6);
    }
  }
}

TEST(ElectricCar, SlidesWhereTheBicycleModelWouldCornerOnIce) {
  FreePlant<Car> car = car_at(20.0);
  car.p[4] = 0.1;  // ice
  car.u[4] = 0.1;
  car.run(2.0, 5e-4);
  // The lateral acceleration r v_x stays within friction, μ g; the bicycle model wants 10 m/s².
  EXPECT_LT(std::abs(car.x[2] * car.x[0]), 0.1 * Car::kGravity_m_s2 * 2.0);
  EXPECT_GT(bicycle_yaw_rate(20.0, 0.1) * 20.0, 9.0);
}

TEST(ElectricCar, LeftAndRightAreMirrored) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (int i = 0; i < 100; ++i) {
    FreePlant<Car> car = car_at(20.0 + 5.0 * unit(random));
    car.x[1] = unit(random);
    car.x[2] = 0.3 * unit(random);
    for (std::size_t j = 3; j < 7; ++j) car.x[j] += 3.0 * unit(random);
    for (std::size_t j = 0; j < 4; ++j) car.u[j] = 300.0 * unit(random);
    car.u[4] = 0.1 * unit(random);
    FreePlant<Car> mirrored = car;
    mirrored.x = {car.x[0], -car.x[1], -car.x[2], car.x[4], car.x[3], car.x[6], car.x[5]};
    mirrored.u = {car.u[1], car.u[0], car.u[3], car.u[2], -car.u[4]};
    const auto rate = car.derivative();
    const auto other = mirrored.derivative();
    const FreePlant<Car>::State expected{rate[0], -rate[1], -rate[2], rate[4],
                                         rate[3], rate[6],  rate[5]};
    for (std::size_t j = 0; j < 7; ++j) EXPECT_NEAR(other[j], expected[j], 1e-10) << j;
  }
}

TEST(ElectricCar, TyreStaysWithinItsCircleOfFrictionAndIsStiffInside) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  constexpr double kLoad_N = 4000.0;
  for (int i = 0; i < 1000; ++i) {
    const auto force =
        Car::tyre(70.0 + 60.0 * unit(random), 20.0, 10.0 * unit(random), kLoad_N, Car::kFriction);
    EXPECT_LE(std::hypot(force.along_N, force.across_N), Car::kFriction * kLoad_N * (1.0 + 1e-12));
  }
  const double slip = 1e-4;
  const double rolling_rad_s = 20.0 / Car::kWheelRadius_m;
  EXPECT_NEAR(Car::tyre(rolling_rad_s * (1.0 + slip), 20.0, 0.0, kLoad_N, 0.9).along_N,
              Car::kLongitudinal_N * slip, 1e-3);
  EXPECT_NEAR(Car::tyre(rolling_rad_s, 20.0, 20.0 * slip, kLoad_N, 0.9).across_N,
              -Car::kCornering_N * slip, 1e-3);
}

TEST(ElectricCar, ADraggingBrakePullsToItsSide) {
  FreePlant<Car> car = car_at(20.0);
  car.p[0] = 200.0;  // front left
  car.run(1.0, 5e-4);
  EXPECT_LT(car.x[0], 20.0);
  EXPECT_GT(car.x[2], 0.0);
  // It holds a car that stands without pushing it back.
  FreePlant<Car> standing = car_at(0.0);
  standing.u = {};
  standing.p[0] = 200.0;
  for (const double rate : standing.derivative()) EXPECT_EQ(rate, 0.0);
}

}  // namespace
}  // namespace faultline

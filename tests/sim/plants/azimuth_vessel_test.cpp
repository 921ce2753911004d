#include "sim/plants/azimuth_vessel.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "tests/sim/plants/free_plant.h"

namespace faultline {
namespace {

using Vector3 = AzimuthVessel::Vector3;

double dot(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

Vector3 velocity(const FreePlant<AzimuthVessel>& vessel) {
  return {vessel.x[3], vessel.x[4], vessel.x[5]};
}

TEST(AzimuthVessel, StandsStillBetweenThrustersThatWorkAgainstEachOther) {
  const FreePlant<AzimuthVessel> vessel;
  for (const double rate : vessel.derivative()) EXPECT_NEAR(rate, 0.0, 1e-15);
}

TEST(AzimuthVessel, CoriolisForceDoesNoWorkAndDampingTakesEnergy) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> speed(-3.0, 3.0);
  for (int i = 0; i < 1000; ++i) {
    const Vector3 nu{speed(random), speed(random), speed(random)};
    const double scale = dot(nu, nu) * std::sqrt(dot(nu, nu)) * 100.0;
    EXPECT_NEAR(dot(nu, AzimuthVessel::coriolis(nu)), 0.0, 1e-15 * scale);
    EXPECT_GT(dot(nu, AzimuthVessel::damping(nu)), 0.0);
    EXPECT_GT(AzimuthVessel::energy_J(nu), 0.0);
  }
}

// Force-free: C(ν) follows from M by Kirchhoff's equations, d/dt ∂T/∂ν = -ω × ∂T/∂ν.
TEST(AzimuthVessel, CoriolisForceIsKirchhoffs) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> speed(-3.0, 3.0);
  for (int i = 0; i < 100; ++i) {
    const Vector3 nu{speed(random), speed(random), speed(random)};
    Vector3 momentum{};  // ∂T/∂ν by differences; T is quadratic: they are exact
    for (std::size_t j = 0; j < 3; ++j) {
      Vector3 ahead = nu;
      Vector3 behind = nu;
      ahead[j] += 0.5;
      behind[j] -= 0.5;
      momentum[j] = AzimuthVessel::energy_J(ahead) - AzimuthVessel::energy_J(behind);
    }
    const Vector3 expected{-momentum[1] * nu[2], momentum[0] * nu[2],
                           nu[0] * momentum[1] - nu[1] * momentum[0]};
    const Vector3 found = AzimuthVessel::coriolis(nu);
    for (std::size_t j = 0; j < 3; ++j) EXPECT_NEAR(found[j], expected[j], 1e-10);
  }
}

TEST(AzimuthVessel, EnergyOfTheUnforcedVesselNeverGrows) {
  constexpr int kSeeds = 200;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    std::mt19937_64 random(static_cast<std::uint64_t>(seed));
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    FreePlant<AzimuthVessel> vessel;
    for (std::size_t i = 0; i < 4; ++i) vessel.u[i] = 0.0;
    vessel.x = {10.0 * unit(random), 10.0 * unit(random), 3.0 * unit(random),
                2.0 * unit(random),  1.0 * unit(random),  1.5 * unit(random)};
    double energy_J = AzimuthVessel::energy_J(velocity(vessel));
    for (int k = 0; k < 3000; ++k) {
      vessel.step(0.02);
      const double next_J = AzimuthVessel::energy_J(velocity(vessel));
      ASSERT_LE(next_J, energy_J) << "seed " << seed << ", step " << k;
      energy_J = next_J;
    }
  }
}

TEST(AzimuthVessel, ReachesTheSpeedAtWhichDragTakesItsThrust) {
  FreePlant<AzimuthVessel> vessel;
  for (std::size_t i = 0; i < 4; ++i) {
    vessel.u[i] = 0.5;
    vessel.u[4 + i] = 0.0;
  }
  vessel.run(600.0, 0.05);
  // 2 N = 0.72253 u + 1.32742 u².
  const double u = (-0.72253 + std::sqrt(0.72253 * 0.72253 + 4.0 * 1.32742 * 2.0)) / 2.0 / 1.32742;
  EXPECT_NEAR(vessel.x[3], u, 1e-9);
  EXPECT_NEAR(vessel.x[4], 0.0, 1e-12);
  EXPECT_NEAR(vessel.x[5], 0.0, 1e-12);
}

TEST(AzimuthVessel, TurnsTowardsTheSideThatItsBowThrustersPush) {
  FreePlant<AzimuthVessel> vessel;
  for (std::size_t i = 0; i < 4; ++i) {
    vessel.u[i] = i < 2 ? 0.5 : 0.0;
    vessel.u[4 + i] = AzimuthVessel::kPi / 2.0;  // to starboard
  }
  vessel.run(5.0, 0.05);
  EXPECT_GT(vessel.x[2], 0.0);
  EXPECT_GT(vessel.x[4], 0.0);
}

TEST(AzimuthVessel, MovesWhereItsBowPoints) {
  FreePlant<AzimuthVessel> vessel;
  vessel.x[2] = AzimuthVessel::kPi / 2.0;
  vessel.x[3] = 0.5;
  const auto rate = vessel.derivative();
  EXPECT_NEAR(rate[0], 0.0, 1e-15);
  EXPECT_NEAR(rate[1], 0.5, 1e-15);
}

}  // namespace
}  // namespace faultline

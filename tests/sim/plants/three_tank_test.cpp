#include "sim/plants/three_tank.h"

#include <cmath>
#include <numeric>

#include <gtest/gtest.h>

#include "tests/sim/plants/free_plant.h"

namespace faultline {
namespace {

constexpr double kOutletArea_cm2 = ThreeTank::kOutflow20 * ThreeTank::kPipeArea_cm2;

double water_ml(const FreePlant<ThreeTank>& tanks) {
  return ThreeTank::kTankArea_cm2 * std::accumulate(tanks.x.begin(), tanks.x.end(), 0.0);
}

TEST(ThreeTank, StandsStillAtItsNominalPoint) {
  const FreePlant<ThreeTank> tanks;
  // The nominal flows are written with five digits: 1e-3 ml/s over the area of a tank.
  for (const double rate : tanks.derivative()) EXPECT_NEAR(rate, 0.0, 1e-3 / 154.0);
}

TEST(ThreeTank, FindsTheSteadyStateOfItsPumps) {
  FreePlant<ThreeTank> tanks;
  tanks.x = {10.0, 10.0, 10.0};
  tanks.u = {20.0, 30.0};
  tanks.run(20'000.0, 1.0);
  // q1 passes both pipes, q1 + q2 the outlet: Q = a S √(2 g Δh).
  const auto head = [](double flow, double coefficient) {
    const double speed = flow / (coefficient * ThreeTank::kPipeArea_cm2);
    return speed * speed / (2.0 * ThreeTank::kGravity_cm_s2);
  };
  const double h2 = head(50.0, ThreeTank::kOutflow20);
  const double h3 = h2 + head(20.0, ThreeTank::kOutflow32);
  EXPECT_NEAR(tanks.x[1], h2, 1e-8);
  EXPECT_NEAR(tanks.x[2], h3, 1e-8);
  EXPECT_NEAR(tanks.x[0], h3 + head(20.0, ThreeTank::kOutflow13), 1e-8);
}

TEST(ThreeTank, KeepsItsWaterWhereTheOutletIsShut) {
  FreePlant<ThreeTank> tanks;
  tanks.x = {50.0, 5.0, 20.0};
  tanks.u = {0.0, 10.0};
  tanks.p[5] = 1.0;
  const double before_ml = water_ml(tanks);
  tanks.run(1000.0, 0.5);
  EXPECT_NEAR(water_ml(tanks), before_ml + 1000.0 * 10.0, 1e-8);
  // Communicating vessels: the flow of pump 2 spreads over all three.
  EXPECT_LT(tanks.x[0] - tanks.x[2], 2.0);
}

TEST(ThreeTank, LosesThroughALeakWhatTheLeakGives) {
  FreePlant<ThreeTank> tanks;
  tanks.x = {40.0, 20.0, 30.0};
  const auto sound = tanks.derivative();
  for (std::size_t i = 0; i < 3; ++i) {
    tanks.p = {};
    tanks.p[i] = 10.0;
    const auto leaking = tanks.derivative();
    for (std::size_t j = 0; j < 3; ++j) {
      const double lost_ml_s =
          i == j ? 0.1 * std::sqrt(2.0 * ThreeTank::kGravity_cm_s2 * tanks.x[i]) : 0.0;
      EXPECT_NEAR((sound[j] - leaking[j]) * ThreeTank::kTankArea_cm2, lost_ml_s, 1e-12);
    }
  }
}

// Tank 2 alone: A h' = -a S √(2 g h), so √h falls in a straight line.
TEST(ThreeTank, DrainsOneTankInTheTimeOfTorricelli) {
  FreePlant<ThreeTank> tanks;
  tanks.x = {0.0, 50.0, 0.0};
  tanks.u = {0.0, 0.0};
  tanks.p[4] = 1.0;  // pipe 3-2 shut
  const double fall_per_s =
      kOutletArea_cm2 / ThreeTank::kTankArea_cm2 * std::sqrt(ThreeTank::kGravity_cm_s2 / 2.0);
  const double until_s = (std::sqrt(50.0) - std::sqrt(1.0)) / fall_per_s;
  EXPECT_NEAR(until_s, 125.1, 0.1);  // two minutes for half a metre: as on the laboratory's bench
  const int steps = 1000;
  for (int k = 0; k < steps; ++k) tanks.step(until_s / steps);
  EXPECT_NEAR(tanks.x[1], 1.0, 1e-8);
}

TEST(ThreeTank, EmptiesWithoutGoingBelowTheBottom) {
  FreePlant<ThreeTank> tanks;
  tanks.x = {10.0, 5.0, 2.0};
  tanks.u = {-100.0, 0.0};  // a pump does not suck
  tanks.p[0] = 10.0;
  for (int k = 0; k < 20'000; ++k) {
    tanks.step(0.1);
    for (const double h : tanks.x) ASSERT_GE(h, 0.0) << k;
  }
  for (const double h : tanks.x) EXPECT_LT(h, 0.1);
}

TEST(ThreeTank, RunsOverAtTheRimAndFallsFromIt) {
  FreePlant<ThreeTank> tanks;
  tanks.x = {ThreeTank::kRim_cm, 20.0, 30.0};
  tanks.u = {ThreeTank::kPumpMost_ml_s, 0.0};
  EXPECT_EQ(tanks.derivative()[0], 0.0);
  tanks.u[0] = 0.0;
  EXPECT_LT(tanks.derivative()[0], 0.0);
  tanks.u[0] = 1e6;  // no pump gives that
  tanks.x[0] = 10.0;
  const double most = tanks.derivative()[0];
  tanks.u[0] = ThreeTank::kPumpMost_ml_s;
  EXPECT_EQ(tanks.derivative()[0], most);
}

TEST(ThreeTank, ItsEventsAreRimsAndHeadsThatTurnLaminar) {
  FreePlant<ThreeTank> tanks;
  std::array<double, ThreeTank::event_count> g{};
  tanks.x = {61.0, 20.0, 20.05};
  ThreeTank::events(tanks.x.data(), tanks.u.data(), tanks.p.data(), tanks.d.data(), g.data());
  EXPECT_NEAR(g[0], 1.0, 1e-12);
  EXPECT_GT(g[3], 0.0);             // pipe 1-3 turbulent
  EXPECT_NEAR(g[4], -0.05, 1e-12);  // pipe 3-2 laminar
  tanks.x[0] = ThreeTank::kRim_cm + 1e-3;
  for (std::size_t event = 0; event < ThreeTank::event_count; ++event) {
    ThreeTank::on_event(event, tanks.u.data(), tanks.p.data(), tanks.d.data(), tanks.x.data());
  }
  EXPECT_EQ(tanks.x, (FreePlant<ThreeTank>::State{ThreeTank::kRim_cm, 20.0, 20.05}));
}

TEST(ThreeTank, TorricelliIsOddAndContinuousWithItsSlope) {
  const double edge = ThreeTank::kLaminarHead_cm;
  const double h = 1e-7;
  EXPECT_NEAR(ThreeTank::torricelli(edge - h), ThreeTank::torricelli(edge + h), 1e-4);
  const double below = (ThreeTank::torricelli(edge - h) - ThreeTank::torricelli(edge - 2 * h)) / h;
  const double above = (ThreeTank::torricelli(edge + 2 * h) - ThreeTank::torricelli(edge + h)) / h;
  EXPECT_NEAR(below / above, 1.0, 1e-4);
  for (const double head : {0.0, 0.01, 0.2, 30.0}) {
    EXPECT_EQ(ThreeTank::torricelli(-head), -ThreeTank::torricelli(head));
  }
}

}  // namespace
}  // namespace faultline

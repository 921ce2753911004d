#include "diagnosis/model/nonlinearity.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using enum FunctionKind;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

NonlinearFunction polynomial(std::vector<double> coefficients, double from, double to) {
  return {.kind = kPolynomial,
          .coefficients = std::move(coefficients),
          .domain_min = from,
          .domain_max = to};
}

NonlinearFunction table(std::vector<double> at, std::vector<double> value) {
  return {.kind = kTable, .at = std::move(at), .value = std::move(value)};
}

std::vector<NonlinearFunction> one_of_each_kind() {
  return {{.kind = kSin},
          {.kind = kCos},
          {.kind = kTanh},
          {.kind = kAtan},
          {.kind = kDeadZone, .width = 0.5},
          {.kind = kSaturation, .width = 0.5},
          polynomial({1.0, -2.0, 0.0, 3.0}, -1.0, 2.0),
          table({-1.0, 0.5, 2.0}, {3.0, -1.0, 4.0})};
}

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform(double from, double to) {
    return std::uniform_real_distribution<double>(from, to)(engine_);
  }
  std::size_t below(std::size_t count) { return engine_() % count; }

 private:
  std::mt19937_64 engine_;
};

NonlinearFunction random_polynomial(Random& random) {
  std::vector<double> coefficients(1 + random.below(9));
  for (double& c : coefficients) c = random.uniform(-2.0, 2.0);
  const double from = random.uniform(-2.0, 1.5);
  return polynomial(std::move(coefficients), from, from + random.uniform(0.1, 3.0));
}

NonlinearFunction random_table(Random& random) {
  std::vector<double> at{random.uniform(-3.0, 0.0)}, value{random.uniform(-2.0, 2.0)};
  const std::size_t count = 2 + random.below(8);
  while (at.size() < count) {
    at.push_back(at.back() + random.uniform(0.01, 1.0));
    value.push_back(random.uniform(-2.0, 2.0));
  }
  return table(std::move(at), std::move(value));
}

// No quotient of differences may leave the bounds. Its own rounding is an ulp or two of φ and of
// the argument over the distance, which is at least `apart`.
void expect_quotients_within_bounds(const NonlinearFunction& function, Random& random) {
  const SlopeBounds bounds = slope_bounds(function);
  const double steepest = std::max(std::abs(bounds.min), std::abs(bounds.max));
  constexpr double kApart = 1e-3;
  for (int trial = 0; trial < 2000; ++trial) {
    const double a = random.uniform(-6.0, 6.0);
    const double b = a + random.uniform(kApart, 2.0) * (trial % 2 == 0 ? 1.0 : -1.0);
    const double phi_a = evaluate(function, a);
    const double phi_b = evaluate(function, b);
    // Horner's rule loses up to 2·degree roundings of the largest term: |φ| alone says too little.
    double terms = std::abs(phi_a) + std::abs(phi_b) + 8.0 * steepest;
    for (std::size_t i = 0; i < function.coefficients.size(); ++i) {
      const double reach = std::max(std::abs(function.domain_min), std::abs(function.domain_max));
      terms += std::abs(function.coefficients[i]) * std::pow(reach, static_cast<double>(i));
    }
    const double rounding = 20.0 * std::numeric_limits<double>::epsilon() * terms / kApart;
    const double quotient = (phi_a - phi_b) / (a - b);
    ASSERT_GE(quotient, bounds.min - rounding) << a << " " << b;
    ASSERT_LE(quotient, bounds.max + rounding) << a << " " << b;
  }
}

TEST(SlopeBounds, HoldForEveryKindOfFunction) {
  const std::uint64_t seed = test_seed(1);
  SCOPED_TRACE(seed_message(seed));
  Random random(seed);
  for (const NonlinearFunction& function : one_of_each_kind()) {
    SCOPED_TRACE(function_name(function.kind));
    expect_quotients_within_bounds(function, random);
  }
}

TEST(SlopeBounds, HoldForRandomPolynomialsAndTablesBeyondTheirDomainToo) {
  const std::uint64_t seed = test_seed(2);
  SCOPED_TRACE(seed_message(seed));
  Random random(seed);
  for (int trial = 0; trial < 300; ++trial) {
    SCOPED_TRACE(trial);
    ASSERT_NO_FATAL_FAILURE(expect_quotients_within_bounds(random_polynomial(random), random));
    ASSERT_NO_FATAL_FAILURE(expect_quotients_within_bounds(random_table(random), random));
  }
}

// Between two samples h apart a slope exceeds theirs by at most h²/8 times the largest third
// derivative, which no more than Σ i(i-1)(i-2) |c_i| R^(i-3) can be.
TEST(SlopeBounds, OfAPolynomialAreReached) {
  const std::uint64_t seed = test_seed(3);
  SCOPED_TRACE(seed_message(seed));
  Random random(seed);
  constexpr int kSamples = 4000;
  for (int trial = 0; trial < 300; ++trial) {
    const NonlinearFunction function = random_polynomial(random);
    const std::vector<double>& c = function.coefficients;
    const double h = (function.domain_max - function.domain_min) / kSamples;
    const double reach = std::max(std::abs(function.domain_min), std::abs(function.domain_max));
    double third = 0.0, size = 0.0, least = kInfinity, most = -kInfinity;
    for (std::size_t i = 1; i < c.size(); ++i) {
      const auto power = static_cast<double>(i);
      size += power * std::abs(c[i]) * std::pow(reach, power - 1.0);
      if (i < 3) continue;
      third += power * (power - 1.0) * (power - 2.0) * std::abs(c[i]) * std::pow(reach, power - 3);
    }
    for (int sample = 0; sample <= kSamples; ++sample) {
      const double s = function.domain_min + sample * h;
      double slope = 0.0;
      for (std::size_t i = 1; i < c.size(); ++i) {
        slope += static_cast<double>(i) * c[i] * std::pow(s, static_cast<double>(i) - 1.0);
      }
      least = std::min(least, slope);
      most = std::max(most, slope);
    }
    const SlopeBounds bounds = slope_bounds(function);
    const double tolerance = h * h / 8.0 * third + 1e-13 * size;
    EXPECT_NEAR(bounds.min, least, tolerance) << trial;
    EXPECT_NEAR(bounds.max, most, tolerance) << trial;
  }
}

TEST(SlopeBounds, OfATableAreThoseOfItsPiecesAndOfItsLevelEnds) {
  const SlopeBounds mixed = slope_bounds(table({0.0, 1.0, 3.0}, {0.0, 2.0, 1.0}));
  EXPECT_EQ(mixed.min, -0.5);
  EXPECT_EQ(mixed.max, 2.0);
  const SlopeBounds rising = slope_bounds(table({0.0, 1.0}, {0.0, 2.0}));
  EXPECT_EQ(rising.min, 0.0) << "beyond its ends it is level";
  EXPECT_EQ(rising.max, 2.0);
  const SlopeBounds falling = slope_bounds(table({0.0, 1.0}, {0.0, -2.0}));
  EXPECT_EQ(falling.min, -2.0);
  EXPECT_EQ(falling.max, 0.0);
}

TEST(SlopeBounds, AreThoseThatCalculusGives) {
  const auto expect = [](const NonlinearFunction& function, double min, double max) {
    const SlopeBounds bounds = slope_bounds(function);
    EXPECT_DOUBLE_EQ(bounds.min, min);
    EXPECT_DOUBLE_EQ(bounds.max, max);
  };
  expect(polynomial({5.0}, -1.0, 1.0), 0.0, 0.0);
  expect(polynomial({5.0, -3.0}, -1.0, 1.0), -3.0, -3.0);
  expect(polynomial({0.0, 0.0, 1.0}, -1.0, 2.0), -2.0, 4.0);
  expect(polynomial({0.0, 0.0, 0.0, 1.0}, -1.0, 2.0), 0.0, 12.0);
  expect(polynomial({0.0, -3.0, 0.0, 1.0}, -2.0, 1.0), -3.0, 9.0);
  expect(polynomial({0.0, 0.0, 0.0, 1.0}, 1.0, 2.0), 3.0, 12.0);
  // T_5 = 16 s^5 - 20 s^3 + 5 s: T_5' = 5 U_4 is 25 at the ends and least, -25/4, at s² = 3/8.
  expect(polynomial({0.0, 5.0, 0.0, -20.0, 0.0, 16.0}, -1.0, 1.0), -6.25, 25.0);
  // s^7: the curvature has a root of order five in the middle.
  expect(polynomial({0, 0, 0, 0, 0, 0, 0, 1}, -1.0, 1.0), 0.0, 7.0);
}

TEST(NonlinearFunction, IsWhatItsNameSays) {
  const auto value = [](const NonlinearFunction& function, double s) {
    return evaluate(function, s);
  };
  EXPECT_DOUBLE_EQ(value({.kind = kSin}, 0.7), std::sin(0.7));
  EXPECT_DOUBLE_EQ(value({.kind = kCos}, 0.7), std::cos(0.7));
  EXPECT_DOUBLE_EQ(value({.kind = kTanh}, 0.7), std::tanh(0.7));
  EXPECT_DOUBLE_EQ(value({.kind = kAtan}, 0.7), std::atan(0.7));
  const NonlinearFunction dead{.kind = kDeadZone, .width = 0.5};
  EXPECT_EQ(value(dead, 0.5), 0.0);
  EXPECT_EQ(value(dead, -0.4), 0.0);
  EXPECT_EQ(value(dead, 0.75), 0.25);
  EXPECT_EQ(value(dead, -0.75), -0.25);
  const NonlinearFunction limited{.kind = kSaturation, .width = 0.5};
  EXPECT_EQ(value(limited, 0.25), 0.25);
  EXPECT_EQ(value(limited, 2.0), 0.5);
  EXPECT_EQ(value(limited, -2.0), -0.5);
  const NonlinearFunction points = table({0.0, 1.0, 3.0}, {4.0, 2.0, 10.0});
  EXPECT_EQ(value(points, -5.0), 4.0);
  EXPECT_EQ(value(points, 0.0), 4.0);
  EXPECT_EQ(value(points, 0.5), 3.0);
  EXPECT_EQ(value(points, 1.0), 2.0);
  EXPECT_EQ(value(points, 2.0), 6.0);
  EXPECT_EQ(value(points, 3.0), 10.0);
  EXPECT_EQ(value(points, 7.0), 10.0);
}

TEST(NonlinearFunction, ContinuesAPolynomialAlongItsTangents) {
  const NonlinearFunction cubic = polynomial({1.0, 0.0, 0.0, 1.0}, -1.0, 2.0);
  EXPECT_EQ(evaluate(cubic, 1.5), 1.0 + 1.5 * 1.5 * 1.5);
  EXPECT_EQ(evaluate(cubic, 2.0), 9.0);
  EXPECT_EQ(evaluate(cubic, 5.0), 9.0 + 12.0 * 3.0);
  EXPECT_EQ(evaluate(cubic, -3.0), 0.0 + 3.0 * -2.0);
}

TEST(NonlinearFunction, PassesOnWhatIsNoNumber) {
  for (const NonlinearFunction& function : one_of_each_kind()) {
    EXPECT_TRUE(std::isnan(evaluate(function, kNan))) << function_name(function.kind);
  }
  EXPECT_TRUE(std::isnan(evaluate(polynomial({1.0}, -1.0, 1.0), kNan)));
}

TEST(NonlinearFunction, HasItsLimitsAtInfinity) {
  for (const double sign : {1.0, -1.0}) {
    const double s = sign * kInfinity;
    EXPECT_TRUE(std::isnan(evaluate({.kind = kSin}, s)));
    EXPECT_TRUE(std::isnan(evaluate({.kind = kCos}, s)));
    EXPECT_EQ(evaluate({.kind = kTanh}, s), sign);
    EXPECT_EQ(evaluate({.kind = kAtan}, s), sign * std::numbers::pi / 2.0);
    EXPECT_EQ(evaluate({.kind = kDeadZone, .width = 0.5}, s), s);
    EXPECT_EQ(evaluate({.kind = kSaturation, .width = 0.5}, s), sign * 0.5);
    EXPECT_EQ(evaluate(polynomial({1.0, -2.0}, -1.0, 1.0), s), -s);
    EXPECT_EQ(evaluate(polynomial({1.0}, -1.0, 1.0), s), 1.0) << "a level tangent stays level";
    EXPECT_EQ(evaluate(table({-1.0, 1.0}, {-3.0, 3.0}), s), sign * 3.0);
  }
}

TEST(NonlinearFunction, StaysFiniteFarAway) {
  for (const NonlinearFunction& function : one_of_each_kind()) {
    for (const double s : {1e300, -1e300, 1e-300, -1e-300, 0.0, -0.0}) {
      EXPECT_TRUE(std::isfinite(evaluate(function, s))) << function_name(function.kind) << " " << s;
    }
  }
}

TEST(NonlinearFunction, DoesNotAllocate) {
  const std::vector<NonlinearFunction> functions = one_of_each_kind();
  double sum = 0.0;
  const AllocationGuard guard;
  for (int k = 0; k < 1000; ++k) {
    for (const NonlinearFunction& function : functions) sum += evaluate(function, 0.01 * k - 5.0);
  }
  EXPECT_EQ(guard.heap_calls(), 0U);
  EXPECT_TRUE(std::isfinite(sum));
}

}  // namespace
}  // namespace faultline

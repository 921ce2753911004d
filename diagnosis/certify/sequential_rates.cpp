#include "diagnosis/certify/sequential_rates.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/LU>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLeastThreshold = 1e-3;
// Of a random walk over a level, both sides together.
constexpr double kOvershoot = 1.166;
// Beyond it the equations take too many nodes; the references that lead there are so small that
// Siegmund's approximation is right to 1 % of the run length.
constexpr double kLongThreshold = 80.0;

double normal_density(double x) {
  return std::exp(-0.5 * x * x) / std::sqrt(2.0 * std::numbers::pi);
}

double normal_distribution(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

struct Quadrature {
  VectorXd node, weight;  // on [0, 1]
};

// Gauss-Legendre by Newton's method on the Legendre polynomial.
Quadrature gauss_legendre(Index count) {
  Quadrature rule{VectorXd(count), VectorXd(count)};
  const auto n = static_cast<double>(count);
  for (Index i = 0; i < count; ++i) {
    double x = std::cos(std::numbers::pi * (static_cast<double>(i) + 0.75) / (n + 0.5));
    double slope = 1.0;
    for (int step = 0; step < 100; ++step) {
      double p = 1.0, before = 0.0;
      for (Index j = 0; j < count; ++j) {
        const auto k = static_cast<double>(j);
        const double next = ((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0);
        before = p;
        p = next;
      }
      slope = n * (x * p - before) / (x * x - 1.0);
      const double move = p / slope;
      x -= move;
      if (std::abs(move) < 1e-15) break;
    }
    rule.node[i] = 0.5 * (1.0 - x);
    rule.weight[i] = 1.0 / ((1.0 - x * x) * slope * slope);
  }
  return rule;
}

// Bisects a function that falls, between powers of ten.
template <class Rate>
double threshold_at(const Rate& rate_of, double rate, double low, double high) {
  while (rate_of(high) > rate) high *= 2.0;
  while (high - low > 1e-6 * high) {
    const double middle = 0.5 * (low + high);
    (rate_of(middle) > rate ? low : high) = middle;
  }
  return high;
}

// ν of Siegmund and Yakir.
double overshoot(double x) {
  if (x < 1e-6) return 1.0;
  const double half = 0.5 * x;
  return (2.0 / x) * (normal_distribution(half) - 0.5) /
         (half * normal_distribution(half) + normal_density(half));
}

}  // namespace

double cusum_run_length(double reference, double threshold, double mean) {
  const double drift = reference - mean;
  const auto count = static_cast<Index>(std::clamp(4.0 * threshold, 24.0, 400.0));
  const Quadrature rule = gauss_legendre(count);
  MatrixXd system(count + 1, count + 1);
  VectorXd from(count + 1);
  from << 0.0, threshold * rule.node;
  for (Index i = 0; i <= count; ++i) {
    system(i, 0) = -normal_distribution(drift - from[i]);
    for (Index j = 0; j < count; ++j) {
      system(i, j + 1) =
          -threshold * rule.weight[j] * normal_density(threshold * rule.node[j] - from[i] + drift);
    }
    system(i, i) += 1.0;
  }
  const VectorXd L = system.partialPivLu().solve(VectorXd::Ones(count + 1));
  return L[0];
}

double cusum_threshold(double reference, double rate) {
  // Longer run lengths lose their digits in the equations; the logarithm grows by 2 κ per h.
  constexpr double kRarest = 1e-10;
  if (rate < kRarest) {
    return cusum_threshold(reference, kRarest) + std::log(kRarest / rate) / (2.0 * reference);
  }
  // A single sample that often beyond κ: any h will do.
  if (normal_distribution(-reference) <= rate) return kLeastThreshold;
  // Siegmund's approximation (Sequential Analysis, 1985) tells where to look; a secant does the
  // rest, for the logarithm of the run length is nearly a line.
  const auto siegmund = [&](double h) {
    const double x = 2.0 * reference * (h + kOvershoot);
    if (x < 1e-4) return (h + kOvershoot) * (h + kOvershoot);
    return (std::expm1(x) - x) / (2.0 * reference * reference);
  };
  const double about = threshold_at([&](double h) { return 1.0 / siegmund(h); }, rate, 0.0, 1.0);
  if (about > kLongThreshold) return about;
  const double wanted = -std::log(rate);
  double a = std::max(about, kLeastThreshold), b = 1.05 * a + 0.01;
  double f_a = std::log(cusum_run_length(reference, a)) - wanted;
  for (int step = 0; step < 12; ++step) {
    const double f_b = std::log(cusum_run_length(reference, b)) - wanted;
    if (std::abs(f_b) < 1e-6 || f_b == f_a) break;
    const double next = std::max(b - f_b * (b - a) / (f_b - f_a), kLeastThreshold);
    a = b;
    f_a = f_b;
    b = next;
  }
  return b;
}

double glr_rate(double threshold, std::uint32_t window) {
  const double b = std::sqrt(2.0 * threshold);
  double sum = 0.0;
  for (std::uint32_t j = 1; j <= window; ++j) {
    const auto length = static_cast<double>(j);
    const double nu = overshoot(b / std::sqrt(length));
    sum += nu * nu / (length * length);
  }
  return 0.5 * b * b * b * normal_density(b) * sum;
}

double glr_threshold(std::uint32_t window, double rate) {
  return threshold_at([&](double h) { return glr_rate(h, window); }, rate, 0.0, 1.0);
}

}  // namespace faultline

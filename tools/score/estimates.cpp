#include "tools/score/estimates.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <boost/math/distributions/binomial.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/special_functions/beta.hpp>
#include <boost/math/special_functions/gamma.hpp>

namespace faultline {
namespace {

constexpr double kTail = 0.025;       // on each side of 95 %
constexpr double kNormal = 1.959964;  // its quantile of the normal distribution
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// ln s, and a Newton step of the logistic likelihood there.
struct Logistic {
  double a = 0.0, b = 0.0;
  double H_aa = 0.0, H_ab = 0.0, H_bb = 0.0;  // information

  /// @return false: it does not converge
  bool fit(const std::vector<Trial>& trials) {
    constexpr int kMostSteps = 100;
    for (int step = 0; step < kMostSteps; ++step) {
      double g_a = 0.0, g_b = 0.0;
      H_aa = H_ab = H_bb = 0.0;
      for (const Trial& trial : trials) {
        const double x = std::log(trial.size);
        const double p = 1.0 / (1.0 + std::exp(-(a + b * x)));
        const double w = p * (1.0 - p);
        const double residual = (trial.is_found ? 1.0 : 0.0) - p;
        g_a += residual;
        g_b += residual * x;
        H_aa += w;
        H_ab += w * x;
        H_bb += w * x * x;
      }
      const double determinant = H_aa * H_bb - H_ab * H_ab;
      if (!(determinant > 1e-12 * H_aa * H_bb)) return false;
      double step_a = (H_bb * g_a - H_ab * g_b) / determinant;
      double step_b = (H_aa * g_b - H_ab * g_a) / determinant;
      const double longest = std::max(std::abs(step_a), std::abs(step_b));
      if (longest > 5.0) {  // far from the maximum a whole step overshoots
        step_a *= 5.0 / longest;
        step_b *= 5.0 / longest;
      }
      a += step_a;
      b += step_b;
      if (longest < 1e-9) return std::isfinite(a) && std::isfinite(b);
    }
    return false;
  }
};

/// The θ farthest from `area` towards `end` (0 or 1) of which `area` of m and n values is no
/// surprise: (area - θ)² = 1.96² V(θ).
double farthest_area(double area, double end, double m, double n) {
  constexpr int kHalvings = 60;
  const auto is_surprise = [&](double theta) {
    const double others = 0.5 * (m + n) - 1.0;
    const double variance =
        theta * (1.0 - theta) *
        (1.0 + others * ((1.0 - theta) / (2.0 - theta) + theta / (1.0 + theta))) / (m * n);
    return (area - theta) * (area - theta) > kNormal * kNormal * variance;
  };
  double inside = area, outside = end;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (inside + outside);
    (is_surprise(middle) ? outside : inside) = middle;
  }
  return inside;
}

/// Of so many successes in so many trials, which need not be whole numbers.
Estimate clopper_pearson(double successes, double trials) {
  Estimate estimate{successes / trials, 0.0, 1.0};
  if (successes > 0.0) {
    estimate.low = boost::math::ibeta_inv(successes, trials - successes + 1.0, kTail);
  }
  if (successes < trials) {
    estimate.high = boost::math::ibeta_inv(successes + 1.0, trials - successes, 1.0 - kTail);
  }
  return estimate;
}

}  // namespace

Estimate proportion(std::uint64_t k, std::uint64_t n) {
  return clopper_pearson(static_cast<double>(k), static_cast<double>(n));
}

Estimate event_rate(std::uint64_t count, double exposure) {
  const auto events = static_cast<double>(count);
  const double low = count == 0 ? 0.0 : boost::math::gamma_p_inv(events, kTail);
  return {events / exposure, low / exposure,
          boost::math::gamma_p_inv(events + 1.0, 1.0 - kTail) / exposure};
}

std::optional<Estimate> clustered_ratio(std::span<const double> part,
                                        std::span<const double> whole) {
  const double sum = std::accumulate(whole.begin(), whole.end(), 0.0);
  if (sum <= 0.0) return std::nullopt;
  const double ratio = std::accumulate(part.begin(), part.end(), 0.0) / sum;
  std::uint64_t runs = 0;
  double squares = 0.0;
  for (std::size_t i = 0; i < part.size(); ++i) {
    if (whole[i] <= 0.0) continue;
    ++runs;
    squares += std::pow(part[i] - ratio * whole[i], 2);
  }
  if (runs < 2) return Estimate{ratio, 0.0, 1.0};
  const auto n = static_cast<double>(runs);
  double trials = n;
  if (squares > 0.0 && ratio > 0.0 && ratio < 1.0) {
    const double t = boost::math::quantile(boost::math::students_t(n - 1.0), 1.0 - kTail);
    const double variance = n / (n - 1.0) * squares / (sum * sum);
    trials = std::min(sum, ratio * (1.0 - ratio) / variance * std::pow(kNormal / t, 2));
  }
  Estimate estimate = clopper_pearson(std::min(ratio * trials, trials), trials);
  estimate.value = ratio;
  return estimate;
}

std::optional<Estimate> quantile(std::span<const double> sorted, std::uint64_t censored, double q) {
  const std::uint64_t n = sorted.size() + censored;
  if (n == 0) return std::nullopt;
  const auto at = [&](std::uint64_t rank) {  // from 0
    return rank < sorted.size() ? sorted[rank] : kInfinity;
  };
  const auto whole = static_cast<double>(n);
  const auto rank = static_cast<std::uint64_t>(std::ceil(q * whole)) - 1;
  // P(X_(l) <= quantile) = P(B >= l) with B binomial (n, q).
  const boost::math::binomial_distribution<double> below(whole, q);
  std::uint64_t low = 0;
  while (low < n && boost::math::cdf(below, static_cast<double>(low)) <= kTail) ++low;
  std::uint64_t high = rank;
  while (high < n && boost::math::cdf(below, static_cast<double>(high)) < 1.0 - kTail) ++high;
  return Estimate{at(rank), low == 0 ? -kInfinity : at(low - 1), at(high)};
}

std::optional<Estimate> area_under_roc(std::vector<double> without,
                                       const std::vector<double>& with) {
  if (without.empty() || with.empty()) return std::nullopt;
  std::sort(without.begin(), without.end());
  double sum = 0.0;
  for (const double value : with) {
    const auto [first, last] = std::equal_range(without.begin(), without.end(), value);
    sum += static_cast<double>(first - without.begin()) + 0.5 * static_cast<double>(last - first);
  }
  const auto m = static_cast<double>(without.size()), n = static_cast<double>(with.size());
  const double area = sum / (m * n);
  return Estimate{area, farthest_area(area, 0.0, m, n), farthest_area(area, 1.0, m, n)};
}

DetectableSize detectable_size(std::vector<Trial> trials, double share) {
  using Kind = DetectableSize::Kind;
  constexpr std::size_t kFewestTrials = 20;
  if (trials.empty()) return {};
  std::sort(trials.begin(), trials.end(),
            [](const Trial& a, const Trial& b) { return a.size < b.size; });
  const double smallest = trials.front().size, largest = trials.back().size;
  double largest_missed = 0.0, smallest_found = kInfinity;
  for (const Trial& trial : trials) {
    if (trial.is_found) {
      smallest_found = std::min(smallest_found, trial.size);
    } else {
      largest_missed = std::max(largest_missed, trial.size);
    }
  }
  if (largest_missed == 0.0) return {Kind::kBelowAll, {smallest, 0.0, smallest}};
  if (smallest_found == kInfinity) return {Kind::kAboveAll, {largest, largest, kInfinity}};
  if (trials.size() < kFewestTrials) return {};
  if (largest_missed < smallest_found) {
    return {Kind::kEstimated,
            {std::sqrt(largest_missed * smallest_found), largest_missed, smallest_found}};
  }
  Logistic curve;
  if (!curve.fit(trials) || curve.b <= 0.0) return {};
  const double logit = std::log(share / (1.0 - share));
  const double x = (logit - curve.a) / curve.b;
  // x = (logit - a) / b: dx = -(1, x) / b · (da, db).
  const double determinant = curve.H_aa * curve.H_bb - curve.H_ab * curve.H_ab;
  const double variance =
      (curve.H_bb - 2.0 * x * curve.H_ab + x * x * curve.H_aa) / (determinant * curve.b * curve.b);
  const double half = kNormal * std::sqrt(std::max(0.0, variance));
  const Estimate size{std::exp(x), std::exp(x - half), std::exp(x + half)};
  if (size.value > largest) return {Kind::kAboveAll, {largest, size.low, size.high}};
  if (size.value < smallest) return {Kind::kBelowAll, {smallest, size.low, smallest}};
  return {Kind::kEstimated, size};
}

}  // namespace faultline

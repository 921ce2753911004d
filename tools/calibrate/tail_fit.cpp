#include "tools/calibrate/tail_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <boost/math/distributions/binomial.hpp>

namespace faultline {
namespace {

constexpr double kLargestShape = 0.5;
constexpr double kNoShape = 1e-6;
// Of independent samples, at most one in so many is a peak of the tail.
constexpr double kSamplesPerPeak = 40.0;
constexpr double kUncorrelated = 0.05;
constexpr std::size_t kParts = 11;
// Half of the 95 % quantile of χ² with one degree of freedom.
constexpr double kInterval = 1.9207;

// log P(excess > z)
double log_survival(double z, double scale, double shape) {
  if (std::abs(shape) < kNoShape) return -z / scale;
  const double inside = 1.0 + shape * z / scale;
  return inside <= 0.0 ? -std::numeric_limits<double>::infinity() : -std::log(inside) / shape;
}

double log_likelihood(const std::vector<double>& excess, double scale, double shape) {
  double sum = -static_cast<double>(excess.size()) * std::log(scale);
  for (const double z : excess) {
    const double survival = log_survival(z, scale, shape);
    if (!std::isfinite(survival)) return -std::numeric_limits<double>::infinity();
    sum += (1.0 + shape) * survival;
  }
  return sum;
}

// The largest value of a function with one maximum, between two ends.
template <class Function>
double golden_section(const Function& f, double low, double high) {
  constexpr double kRatio = 0.6180339887498949;
  double a = high - kRatio * (high - low), b = low + kRatio * (high - low);
  double f_a = f(a), f_b = f(b);
  for (int step = 0; step < 60; ++step) {
    if (f_a > f_b) {
      high = b;
      b = a;
      f_b = f_a;
      a = high - kRatio * (high - low);
      f_a = f(a);
    } else {
      low = a;
      a = b;
      f_a = f_b;
      b = low + kRatio * (high - low);
      f_b = f(b);
    }
  }
  return 0.5 * (low + high);
}

struct ScaleRange {
  double low, high;  // logarithms
};

ScaleRange scale_range(const std::vector<double>& excess) {
  double mean = 0.0;
  for (const double z : excess) mean += z;
  mean /= static_cast<double>(excess.size());
  return {std::log(0.2 * mean), std::log(5.0 * mean)};
}

void fit_excess(TailFit& fit) {
  const ScaleRange range = scale_range(fit.excess);
  const auto best_scale = [&](double shape) {
    return std::exp(golden_section(
        [&](double log_scale) { return log_likelihood(fit.excess, std::exp(log_scale), shape); },
        range.low, range.high));
  };
  fit.shape = golden_section(
      [&](double shape) { return log_likelihood(fit.excess, best_scale(shape), shape); },
      -kLargestShape, kLargestShape);
  fit.scale = best_scale(fit.shape);
}

std::size_t finite_count(std::span<const double> series) {
  return static_cast<std::size_t>(
      std::count_if(series.begin(), series.end(), [](double x) { return !std::isnan(x); }));
}

std::size_t decorrelation_within(std::span<const double> series, std::size_t most) {
  double mean = 0.0, count = 0.0;
  for (const double value : series) {
    if (std::isnan(value)) continue;
    mean += value;
    count += 1.0;
  }
  if (count < 2.0) return 1;
  mean /= count;
  const auto covariance = [&](std::size_t lag) {
    double sum = 0.0;
    for (std::size_t k = lag; k < series.size(); ++k) {
      const double product = (series[k] - mean) * (series[k - lag] - mean);
      if (!std::isnan(product)) sum += product;
    }
    return sum;
  };
  const double variance = covariance(0);
  // In steps that grow: what is between them is longer than needed.
  for (std::size_t lag = 1; lag < most; lag += 1 + lag / 8) {
    if (!(covariance(lag) > kUncorrelated * variance)) return lag;
  }
  return most;
}

// The profile of the rate beyond the threshold.
RateInterval interval_of(const TailFit& fit, double threshold) {
  // The likelihood of the peaks on a grid of σ and ξ, once; and what each says of the rate beyond
  // the threshold.
  struct Point {
    double likelihood, log_survival;
  };
  constexpr int kShapes = 101, kScales = 161;
  const ScaleRange range = scale_range(fit.excess);
  const double above = std::max(threshold - fit.level, 0.0);
  std::vector<Point> points;
  for (int i = 0; i < kShapes; ++i) {
    const double shape = -kLargestShape + 2.0 * kLargestShape * i / (kShapes - 1);
    for (int j = 0; j < kScales; ++j) {
      const double scale = std::exp(range.low + (range.high - range.low) * j / (kScales - 1));
      const double survival = log_survival(above, scale, shape);
      const double likelihood = log_likelihood(fit.excess, scale, shape);
      if (std::isfinite(likelihood) && std::isfinite(survival))
        points.push_back({likelihood, survival});
    }
  }
  const auto n = static_cast<double>(fit.clusters);
  const auto profile = [&](double log_rate) {
    double best = -std::numeric_limits<double>::infinity();
    for (const Point& point : points) {
      const double log_above = log_rate - point.log_survival;  // of the clusters, per sample
      best = std::max(best, point.likelihood + n * log_above - std::exp(log_above) * fit.samples);
    }
    return best;
  };
  // The largest there is, by the fit itself.
  const double peak =
      log_likelihood(fit.excess, fit.scale, fit.shape) + n * std::log(n / fit.samples) - n;
  const double estimate = std::log(fit.rate(threshold));
  const auto end = [&](double direction) {
    double inside = 0.0, outside = 1.0;
    while (outside < 60.0 && profile(estimate + direction * outside) > peak - kInterval) {
      inside = outside;
      outside *= 1.6;
    }
    for (int step = 0; step < 25; ++step) {
      const double middle = 0.5 * (inside + outside);
      (profile(estimate + direction * middle) > peak - kInterval ? inside : outside) = middle;
    }
    return std::exp(estimate + direction * outside);
  };
  return {end(-1.0), end(1.0)};
}

}  // namespace

double TailFit::rate(double threshold) const {
  const double above = static_cast<double>(clusters) / samples;
  return above * std::exp(log_survival(std::max(threshold - level, 0.0), scale, shape));
}

double TailFit::threshold(double wanted_rate) const {
  const double depth =
      std::max(std::log(static_cast<double>(clusters) / samples / wanted_rate), 0.0);
  return level +
         (std::abs(shape) < kNoShape ? scale * depth : scale / shape * std::expm1(shape * depth));
}

std::vector<double> cluster_peaks(std::span<const double> series, double level, std::size_t gap) {
  std::vector<double> peaks;
  std::size_t quiet = gap;  // samples since the last exceedance
  for (const double value : series) {
    if (std::isnan(value)) {
      quiet = gap;
    } else if (value > level) {
      if (quiet >= gap) {
        peaks.push_back(value);
      } else {
        peaks.back() = std::max(peaks.back(), value);
      }
      quiet = 0;
    } else {
      ++quiet;
    }
  }
  return peaks;
}

std::size_t decorrelation(std::span<const double> series) {
  const std::size_t part = std::max<std::size_t>(series.size() / kParts, 1);
  const std::size_t most = std::max<std::size_t>(series.size() / 100, 1);
  std::vector<std::size_t> lags;
  for (std::size_t begin = 0; begin + part <= series.size(); begin += part) {
    lags.push_back(decorrelation_within(series.subspan(begin, part), most));
  }
  if (lags.empty()) return 1;
  const auto middle = lags.begin() + static_cast<std::ptrdiff_t>(lags.size() / 2);
  std::nth_element(lags.begin(), middle, lags.end());
  return *middle;
}

std::optional<TailFit> fit_tail(std::span<const double> series, std::size_t gap,
                                std::size_t clusters) {
  std::vector<double> sorted;
  for (const double value : series) {
    if (!std::isnan(value)) sorted.push_back(value);
  }
  const double independent = static_cast<double>(sorted.size()) / static_cast<double>(gap);
  const auto wanted = std::min(clusters, static_cast<std::size_t>(independent / kSamplesPerPeak));
  if (wanted < kFewestClusters) return std::nullopt;
  std::sort(sorted.begin(), sorted.end());
  // Fewer samples above the level make fewer clusters, nearly always: bisect, then take what is.
  std::size_t few = wanted - 1, many = sorted.size() / 4;
  while (many - few > 1) {
    const std::size_t middle = few + (many - few) / 2;
    const double level = sorted[sorted.size() - 1 - middle];
    (cluster_peaks(series, level, gap).size() >= wanted ? many : few) = middle;
  }
  TailFit fit;
  fit.level = sorted[sorted.size() - 1 - many];
  for (const double peak : cluster_peaks(series, fit.level, gap)) {
    fit.excess.push_back(peak - fit.level);
  }
  fit.clusters = fit.excess.size();
  fit.samples = static_cast<double>(finite_count(series));
  if (fit.clusters < kFewestClusters) return std::nullopt;
  fit_excess(fit);
  return fit;
}

RateInterval rate_interval(std::span<const double> series, std::size_t gap, double threshold) {
  RateInterval all{std::numeric_limits<double>::infinity(), 0.0};
  for (const std::size_t clusters : std::array<std::size_t, 3>{400, 200, 100}) {
    const std::optional<TailFit> fit = fit_tail(series, gap, clusters);
    if (!fit) continue;
    const RateInterval one = interval_of(*fit, threshold);
    all.low = std::min(all.low, one.low);
    all.high = std::max(all.high, one.high);
  }
  return all;
}

double same_rate_probability(std::size_t count, double samples, std::size_t other,
                             double other_samples) {
  const auto total = static_cast<double>(count + other);
  if (total == 0.0) return 1.0;
  const boost::math::binomial_distribution<double> split(total,
                                                         samples / (samples + other_samples));
  const auto k = static_cast<double>(count);
  const double below = boost::math::cdf(split, k);
  const double above = k == 0.0 ? 1.0 : boost::math::cdf(boost::math::complement(split, k - 1.0));
  return std::min(1.0, 2.0 * std::min(below, above));
}

}  // namespace faultline

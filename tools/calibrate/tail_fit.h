#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace faultline {

/// The tail of a stationary series: independent peaks (clusters) above a level u come `rate` times
/// per sample, and what they exceed it by follows a generalised Pareto distribution,
///
///   P(peak - u > z) = (1 + ξ z / σ)^(-1/ξ)   (exp(-z / σ) for ξ = 0)
///
/// Pickands, Ann. Statist. 3 (1975) 119-131; Coles, An Introduction to Statistical Modeling of
/// Extreme Values, 2001, ch. 4 and 5.
struct TailFit {
  double level = 0.0;          ///< u
  double scale = 0.0;          ///< σ
  double shape = 0.0;          ///< ξ
  std::size_t clusters = 0;    ///< n
  double samples = 0.0;        ///< of the record
  std::vector<double> excess;  ///< n peaks above u

  /// Expected clusters per sample whose peak is above `threshold` >= u.
  [[nodiscard]] double rate(double threshold) const;
  /// The threshold that is exceeded `wanted_rate` times per sample; at least u.
  [[nodiscard]] double threshold(double wanted_rate) const;
};

/// The peaks of clusters above `level`: exceedances that are fewer than `gap` samples apart belong
/// together. A NaN ends a stretch of the record.
[[nodiscard]] std::vector<double> cluster_peaks(std::span<const double> series, double level,
                                                std::size_t gap);

/// The number of samples after which values of the series say nothing of each other: the first lag
/// at which their correlation is below 0.05, at most a hundredth of the series; the median of
/// eleven parts, so that something that happened in few of them does not count. A NaN is left out.
[[nodiscard]] std::size_t decorrelation(std::span<const double> series);

/// A tail of fewer clusters is none.
inline constexpr std::size_t kFewestClusters = 50;

/// Maximum likelihood of σ and ξ (-0.5 <= ξ <= 0.5) above the level that leaves `clusters` of them,
/// or as many as a fortieth of the independent samples if that is fewer.
/// @return nothing if fewer than `kFewestClusters` are left
[[nodiscard]] std::optional<TailFit> fit_tail(std::span<const double> series, std::size_t gap,
                                              std::size_t clusters = 200);

/// Clusters per sample.
struct RateInterval {
  double low = 0.0, high = 0.0;
};

/// A 95 % confidence interval of the clusters per sample whose peak is above `threshold`: by the
/// profile likelihood of that rate, the number of clusters (Poisson) and their peaks together; and
/// as no level is known to be high enough for the tail to be what it is in the limit, the smallest
/// interval that holds those of 400, 200 and 100 clusters.
/// @pre fit_tail(series, gap) is there
[[nodiscard]] RateInterval rate_interval(std::span<const double> series, std::size_t gap,
                                         double threshold);

/// Whether two counts may come from one rate: the two-sided probability of a split as uneven as
/// this, or more (binomial).
[[nodiscard]] double same_rate_probability(std::size_t count, double samples, std::size_t other,
                                           double other_samples);

}  // namespace faultline

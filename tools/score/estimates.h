#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace faultline {

// What runs tell of a bank, with 95 % intervals. Pure functions of their arguments.

/// An estimate and the interval that holds the truth with a probability of 95 %.
struct Estimate {
  double value = 0.0, low = 0.0, high = 0.0;
};

/// A probability from k successes in n independent trials; Clopper and Pearson's interval, which
/// never holds less than it says. @pre 0 <= k <= n, n > 0
[[nodiscard]] Estimate proportion(std::uint64_t k, std::uint64_t n);

/// Events per unit from `count` events in `exposure` units; exact interval of a Poisson count.
/// @pre exposure > 0
[[nodiscard]] Estimate event_rate(std::uint64_t count, double exposure);

/// r = Σ part / Σ whole over runs: cycles of one run are not independent, runs are. The interval is
/// Clopper's and Pearson's of as many independent trials as would have the variance of r,
///
///   v = n / (n-1) Σ (part_i - r whole_i)² / (Σ whole)²,  n* = r (1-r) / v (1.96 / t_n-1)²
///
/// at most Σ whole (Korn, Graubard, Survey Methodology 24 (1998) 193-201): unlike r ± 1.96 √v it
/// serves rates near 0 and 1, too. Where all runs agree, n* = n. Absent where the whole is zero.
/// @pre 0 <= part_i <= whole_i
[[nodiscard]] std::optional<Estimate> clustered_ratio(std::span<const double> part,
                                                      std::span<const double> whole);

/// The quantile q of values of which `censored` more are larger than all (faults that were not
/// found): order statistics, and the pair of them that holds the quantile with 95 % by the binomial
/// distribution. Infinite where it lies among the censored; -infinite
/// below where there are too few values for a lower bound. @pre sorted; 0 < q < 1
[[nodiscard]] std::optional<Estimate> quantile(std::span<const double> sorted,
                                               std::uint64_t censored, double q);

/// The area under the ROC curve: probability that a value with a fault is larger than one without
/// (ties count half). The interval holds every θ whose estimate could well be this one:
///
///   |θ^ - θ| <= 1.96 √V(θ),
///   V(θ) = θ(1-θ) (1 + (N-1) ((1-θ)/(2-θ) + θ/(1+θ))) / (m n),  N = (m+n)/2
///
/// (Newcombe, Statist. Med. 25 (2006) 559-573, method 5: Hanley's and McNeil's variance at θ, so
/// that areas near 1 of few values are not taken for certain). Absent where either is empty.
[[nodiscard]] std::optional<Estimate> area_under_roc(std::vector<double> without,
                                                     const std::vector<double>& with);

/// One fault and whether it was found.
struct Trial {
  double size = 0.0;  ///< > 0
  bool is_found = false;
};

/// From which size on a fault is found in `share` of the cases.
struct DetectableSize {
  enum class Kind {
    kEstimated,  ///< `size`
    kBelowAll,   ///< all were found: at most size.value, the smallest tried
    kAboveAll,   ///< the largest tried, size.value, is not found so often
    kUndecided,  ///< finding does not grow with size, or there are too few trials
  };
  Kind kind = Kind::kUndecided;
  Estimate size;
};

/// Logistic regression of finding on ln(size), p = 1 / (1 + e^-(a + b ln s)), by Newton's method;
/// the interval by the delta method. Where every larger fault was found and every smaller one was
/// not, the likelihood has no maximum: then the answer lies between the two (and its middle is
/// given).
[[nodiscard]] DetectableSize detectable_size(std::vector<Trial> trials, double share = 0.95);

}  // namespace faultline

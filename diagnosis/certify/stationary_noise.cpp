#include "diagnosis/certify/stationary_noise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include <boost/math/special_functions/erf.hpp>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kMostSquarings = 40;
constexpr std::size_t kMostPatterns = 1024;
// Dimensions of a probability: samples that exceed, and the one before.
constexpr std::size_t kMostSamples = 11;
// Of one pattern alone; of many fewer each, as their errors are different.
constexpr std::size_t kLatticePoints = 4093;
constexpr std::size_t kFewestPoints = 127;
// Patterns below this part of the largest together do not count.
constexpr double kRarePattern = 1e-4;
constexpr double kLargestFactor = 64.0;
// A variance below this part of the largest is rounding: the variable is given by those before it.
constexpr double kSingular = 1e-10;

double upper_tail(double x) { return 0.5 * std::erfc(x / std::numbers::sqrt2); }

double upper_quantile(double q) {
  const double p = std::clamp(q, std::numeric_limits<double>::min(), 1.0 - 1e-16);
  return std::numbers::sqrt2 * boost::math::erfc_inv(2.0 * p);
}

// One box of a Gaussian vector: all but the last coordinate above its bound, the last within ±.
class OrthantProbability {
 public:
  OrthantProbability(const MatrixXd& covariance, const VectorXd& bound)
      : n_(covariance.rows()), bound_(bound), L_(MatrixXd::Zero(n_, n_)) {
    const double least = kSingular * covariance.diagonal().maxCoeff();
    for (Index j = 0; j < n_; ++j) {
      const double left = covariance(j, j) - L_.row(j).squaredNorm();
      L_(j, j) = std::sqrt(std::max(left, least));
      for (Index i = j + 1; i < n_; ++i) {
        L_(i, j) = (covariance(i, j) - L_.row(i).head(j).dot(L_.row(j).head(j))) / L_(j, j);
      }
    }
  }

  [[nodiscard]] double value(std::size_t points) const {
    // Richtmyer's lattice, folded (baker's transformation).
    static constexpr std::array<double, kMostSamples> kGenerators = {
        0.41421356237309515, 0.7320508075688772,  0.23606797749978969, 0.6457513110645907,
        0.3166247903553998,  0.60555127546398912, 0.12310562561766059, 0.35889894354067355,
        0.79583152331271954, 0.38516480713450403, 0.56776436283002194};
    double sum = 0.0;
    std::array<double, kMostSamples> y{};
    for (std::size_t point = 0; point < points; ++point) {
      double probability = 1.0;
      for (Index i = 0; i < n_ && probability > 0.0; ++i) {
        double given = 0.0;
        for (Index j = 0; j < i; ++j) given += L_(i, j) * y[static_cast<std::size_t>(j)];
        if (i == n_ - 1) {
          const double low = (-bound_[i] - given) / L_(i, i);
          const double high = (bound_[i] - given) / L_(i, i);
          probability *=
              low > 0.0 ? upper_tail(low) - upper_tail(high) : upper_tail(-high) - upper_tail(-low);
          break;
        }
        const double tail = upper_tail((bound_[i] - given) / L_(i, i));
        probability *= tail;
        const auto dimension = static_cast<std::size_t>(i);
        const double at = (static_cast<double>(point) + 0.5) * kGenerators[dimension];
        const double w = std::abs(2.0 * (at - std::floor(at)) - 1.0);
        y[dimension] = upper_quantile(tail * std::max(w, 1e-12));
      }
      sum += probability;
    }
    return sum / static_cast<double>(points);
  }

 private:
  Index n_;
  VectorXd bound_;
  MatrixXd L_;
};

// P(all above their bounds) is at most P(aᵀx > aᵀbound) for any a >= 0: the least over a few a.
double probability_bound(const MatrixXd& covariance, const VectorXd& bound) {
  const Index n = covariance.rows() - 1;
  const MatrixXd S = covariance.topLeftCorner(n, n);
  VectorXd a = VectorXd::Ones(n) / static_cast<double>(n);
  double best = 1.0;
  for (int step = 0; step < 20; ++step) {
    const VectorXd Sa = S * a;
    const double variance = a.dot(Sa);
    if (variance <= 0.0) return 0.0;
    best = std::min(best, upper_tail(a.dot(bound.head(n)) / std::sqrt(variance)));
    // Weight to where aᵀbound grows faster than the deviation.
    const VectorXd gain = bound.head(n) / a.dot(bound.head(n)) - Sa / variance;
    a = (a.array() * (0.5 * gain.array() * static_cast<double>(n)).min(2.0).max(-2.0).exp())
            .matrix();
    a /= a.sum();
  }
  return best;
}

// Which samples of the dwell are looked at: all, or some where there are too many patterns.
std::vector<std::size_t> chosen_samples(std::size_t dwell, std::size_t choices) {
  std::size_t count = 1;
  std::size_t patterns = choices;
  while (count < dwell && count + 1 < kMostSamples && patterns * choices <= kMostPatterns) {
    ++count;
    patterns *= choices;
  }
  std::vector<std::size_t> samples;
  for (std::size_t i = 0; i < count; ++i) {
    samples.push_back(count == 1 ? 0 : i * (dwell - 1) / (count - 1));
  }
  return samples;
}

}  // namespace

std::vector<MatrixXd> autocovariances(const StableSystem& system, std::size_t lags) {
  MatrixXd P = system.B * system.B.transpose();
  MatrixXd power = system.A;
  for (int i = 0; i < kMostSquarings && power.norm() > 1e-12; ++i) {
    P += (power * P * power.transpose()).eval();
    power = (power * power).eval();
    if (!P.allFinite()) break;
  }
  if (!P.allFinite() || !(power.norm() < 1.0)) {
    throw std::invalid_argument("its filter is not stable, or forgets too slowly");
  }
  std::vector<MatrixXd> R;
  R.push_back(system.C * P * system.C.transpose() + system.D * system.D.transpose());
  MatrixXd right = system.A * P * system.C.transpose() + system.B * system.D.transpose();
  for (std::size_t j = 1; j <= lags; ++j) {
    R.push_back(system.C * right);
    right = (system.A * right).eval();
  }
  return R;
}

double exceedance_rate(const std::vector<MatrixXd>& R, const VectorXd& level, std::size_t dwell) {
  const auto rows = static_cast<std::size_t>(level.size());
  const std::size_t choices = 2 * rows;
  const std::vector<std::size_t> samples = chosen_samples(dwell, choices);
  const std::size_t n = samples.size();
  std::size_t patterns = 1;
  for (std::size_t i = 0; i < n; ++i) patterns *= choices;

  struct Pattern {
    MatrixXd covariance;
    VectorXd bound;
    double most = 0.0;
  };
  std::vector<Pattern> all;
  double largest = 0.0;
  const auto covariance_of = [&](std::size_t k, std::size_t i, std::size_t l, std::size_t j) {
    const auto a = static_cast<Index>(i), b = static_cast<Index>(j);
    return k >= l ? R[k - l](a, b) : R[l - k](b, a);
  };
  // By symmetry the first sign is positive.
  for (std::size_t number = 0; number < patterns; ++number) {
    std::vector<std::size_t> row(n + 1), time(n + 1);
    std::vector<double> sign(n + 1, 1.0);
    std::size_t rest = number;
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t choice = rest % choices;
      rest /= choices;
      row[i] = choice / 2;
      sign[i] = choice % 2 == 0 ? 1.0 : -1.0;
      time[i] = samples[i] + 1;
    }
    if (sign[0] < 0.0) continue;
    row[n] = row[0];  // the sample before
    time[n] = 0;
    Pattern pattern{MatrixXd(n + 1, n + 1), VectorXd(n + 1)};
    for (std::size_t i = 0; i <= n; ++i) {
      const auto a = static_cast<Index>(i);
      pattern.bound[a] = level[static_cast<Index>(row[i])];
      for (std::size_t j = 0; j <= n; ++j) {
        pattern.covariance(a, static_cast<Index>(j)) =
            sign[i] * sign[j] * covariance_of(time[i], row[i], time[j], row[j]);
      }
    }
    pattern.most = probability_bound(pattern.covariance, pattern.bound);
    largest = std::max(largest, pattern.most);
    all.push_back(std::move(pattern));
  }
  const auto is_rare = [&](const Pattern& pattern) {
    return pattern.most * static_cast<double>(all.size()) < kRarePattern * largest;
  };
  const auto common = static_cast<std::size_t>(
      std::count_if(all.begin(), all.end(), [&](const Pattern& one) { return !is_rare(one); }));
  const std::size_t points =
      std::max(kFewestPoints, kLatticePoints / std::max<std::size_t>(common, 1));
  double rate = 0.0;
  for (const Pattern& pattern : all) {
    rate += is_rare(pattern) ? pattern.most
                             : OrthantProbability(pattern.covariance, pattern.bound).value(points);
  }
  return 2.0 * rate;
}

double exceedance_factor(const std::vector<MatrixXd>& R, std::size_t dwell, double rate) {
  const VectorXd deviation = R.front().diagonal().cwiseMax(0.0).cwiseSqrt();
  // The square root of the rate's logarithm is nearly a line in c.
  const auto depth = [&](double c) {
    return std::sqrt(
        -std::log(std::clamp(exceedance_rate(R, c * deviation, dwell), 1e-300, 0.999)));
  };
  const double wanted = std::sqrt(-std::log(rate));
  double low = 0.05, high = 1.0;
  double at_low = depth(low) - wanted;
  if (at_low > 0.0) return low;
  double at_high = depth(high) - wanted;
  for (; at_high < 0.0 && high < kLargestFactor; at_high = depth(high) - wanted) {
    low = high;
    at_low = at_high;
    high *= 2.0;
  }
  // Regula falsi, the end that stays halved (Illinois).
  for (int step = 0; step < 40 && high - low > 1e-4 * high; ++step) {
    const double c = high - at_high * (high - low) / (at_high - at_low);
    const double at_c = depth(c) - wanted;
    if (std::abs(at_c) < 1e-4 * wanted) return c;
    if (at_c < 0.0) {
      low = c;
      at_low = at_c;
      at_high *= 0.5;
    } else {
      high = c;
      at_high = at_c;
      at_low *= 0.5;
    }
  }
  return high;
}

}  // namespace faultline

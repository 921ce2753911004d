#include "diagnosis/certify/error_bounds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <Eigen/LU>
#include <fmt/format.h>

#include "diagnosis/certify/power_bound.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Of a sum of absolute values what is left out is below this part of it.
constexpr double kNegligible = 1e-15;
// An observer that is summed over for longer forgets too slowly to be of use.
constexpr Index kMostSamples = 200'000;
// Rates of decay that are tried as bounds: powers of the spectral radius.
constexpr std::array kRates = {0.95, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2, 0.1, 0.05, 0.02, 0.01};

MatrixXd stacked(const MatrixXd& top, const MatrixXd& bottom) {
  MatrixXd both(top.rows() + bottom.rows(), top.cols());
  both << top, bottom;
  return both;
}

// Σ_k |rows N^k B|, element by element, to kNegligible of each row; nothing if that takes too long.
std::optional<MatrixXd> absolute_sum(const MatrixXd& rows, const MatrixXd& N, const MatrixXd& B) {
  const std::optional<double> powers = power_sum_bound(N);
  if (!powers) return std::nullopt;
  MatrixXd sum = MatrixXd::Zero(rows.rows(), B.cols());
  MatrixXd left = rows;
  const double rest = *powers * B.norm();
  for (Index k = 0; k < kMostSamples; ++k) {
    sum += (left * B).cwiseAbs();
    left = (left * N).eval();
    const VectorXd missing = rest * left.rowwise().norm();
    if ((missing.array() <= kNegligible * sum.rowwise().sum().array()).all()) return sum;
    // Rows that see nothing of B: their sum is zero, or rounding errors of it.
    if (left.norm() * rest <= kNegligible * kNegligible * rows.norm() * B.norm()) return sum;
  }
  return std::nullopt;
}

}  // namespace

class ErrorBounds::Recursion {
 public:
  explicit Recursion(const ErrorBounds& bounds) : bounds_(bounds) {}

  /// The next sample of the bounds, of all rows, from what they would be without Lipschitz terms.
  VectorXd next(VectorXd bound) {
    const Index terms = bounds_.loop_.terms();
    if (terms == 0) return bound;
    const std::size_t count = std::min(q_.size(), bounds_.G_.size());
    for (std::size_t j = 1; j <= count; ++j) {
      bound.noalias() += bounds_.G_[j - 1] * q_[q_.size() - j];
    }
    q_.emplace_back(bound.tail(terms));
    return bound;
  }

 private:
  const ErrorBounds& bounds_;
  std::vector<VectorXd> q_;
};

ErrorBounds::ErrorBounds(const ObserverLoop& loop)
    : loop_(loop),
      rows_(stacked(loop.R, loop.E_i)),
      Q_(stacked(loop.Q, MatrixXd::Zero(loop.E_i.rows(), loop.Q.cols()))) {
  const auto refuse = [](const std::string& why) {
    throw std::invalid_argument("its error cannot be bounded: " + why);
  };
  const double radius = spectral_radius(loop.N);
  if (!(radius < 1.0)) {
    refuse(
        fmt::format("spectral radius {:.6g} with the slopes in the middle, expected a stable "
                    "observer (below 1)",
                    radius));
  }
  // h_j, j >= 1: rows N^(j-1) (B_now + N B_next).
  const std::optional<MatrixXd> later =
      absolute_sum(rows_, loop.N, loop.B_now + loop.N * loop.B_next);
  const std::optional<MatrixXd> gains = absolute_sum(rows_, loop.N, loop.S_E);
  if (!later || !gains) {
    refuse(fmt::format("spectral radius {:.9g}, it forgets too slowly", radius));
  }
  const MatrixXd sum = (Q_ + rows_ * loop.B_next).cwiseAbs() + *later;
  const std::optional<VectorXd> limit = close(sum * loop.w_bound, *gains);
  if (!limit) {
    refuse(
        "the small gain theorem does not hold, its Lipschitz terms may feed themselves: expected "
        "narrower slopes, or an observer that sees less of them");
  }
  limit_ = limit->head(loop.R.rows());

  if (loop.terms() == 0) return;
  const double power = largest_power(loop.N);
  const double smallest = kNegligible * gains->maxCoeff();
  MatrixXd left = rows_;
  while (std::ssize(G_) < kMostSamples && left.norm() * power * loop.S_E.norm() > smallest) {
    G_.emplace_back((left * loop.S_E).cwiseAbs() * loop.radius.asDiagonal());
    left = (left * loop.N).eval();
  }
}

// b = direct + gains·diag(radius)·q, q the rows of E_i in b.
std::optional<VectorXd> ErrorBounds::close(const MatrixXd& direct, const MatrixXd& gains) const {
  const Index terms = loop_.terms();
  if (terms == 0) return direct;
  const MatrixXd G = gains * loop_.radius.asDiagonal();
  const MatrixXd G_q = G.bottomRows(terms);
  if (!(spectral_radius(G_q) < 1.0)) return std::nullopt;
  const MatrixXd pencil = MatrixXd::Identity(terms, terms) - G_q;
  const VectorXd q = pencil.partialPivLu().solve(direct.bottomRows(terms)).col(0);
  return VectorXd(direct + G * q);
}

MatrixXd ErrorBounds::course(std::size_t samples) const {
  const auto count = static_cast<Index>(samples);
  const VectorXd& w = loop_.w_bound;
  MatrixXd course(count, loop_.R.rows());
  Recursion recursion(*this);
  MatrixXd left = rows_;                                          // R' N^k
  MatrixXd before;                                                // R' N^(k-1)
  VectorXd settled = (Q_ + rows_ * loop_.B_next).cwiseAbs() * w;  // Σ_{j<k} |h_j| w̄
  for (Index k = 0; k < count; ++k) {
    VectorXd direct = left.cwiseAbs() * loop_.e_bound;
    if (k == 0) {
      direct += Q_.cwiseAbs() * w;
    } else {
      direct += settled + (before * loop_.B_now).cwiseAbs() * w;
      settled += (before * loop_.B_now + left * loop_.B_next).cwiseAbs() * w;
    }
    course.row(k) = recursion.next(direct).head(course.cols()).transpose();
    before = left;
    left = before * loop_.N;
  }
  return course;
}

MatrixXd ErrorBounds::fading(const Start& start, std::size_t samples) const {
  const auto count = static_cast<Index>(samples);
  MatrixXd course(count, loop_.R.rows());
  Recursion recursion(*this);
  MatrixXd left = rows_;
  for (Index k = 0; k < count; ++k) {
    const VectorXd direct = (left * start.directions).cwiseAbs() * start.size;
    course.row(k) = recursion.next(direct).head(course.cols()).transpose();
    left = (left * loop_.N).eval();
  }
  return course;
}

// With σ > 1 and σN stable, σ^k |R' e_k| <= f + W q: the same small gain for the weighted error,
// f = Σ_k |R' (σN)^k ..| and W = σ Σ_k |R' (σN)^k S_E|. So the bound falls like σ^-k.
std::optional<std::size_t> ErrorBounds::horizon(const Start& start, const Measure& measure,
                                                double part) const {
  const double radius = std::max(spectral_radius(loop_.N), 1e-3);
  std::optional<std::size_t> best;
  for (const double rate : kRates) {
    const double sigma = std::pow(radius, -rate);
    const MatrixXd N = sigma * loop_.N;
    const std::optional<MatrixXd> first = absolute_sum(rows_, N, start.directions);
    const std::optional<MatrixXd> gains = absolute_sum(rows_, N, sigma * loop_.S_E);
    if (!first || !gains) continue;
    const std::optional<VectorXd> bound = close(*first * start.size, *gains);
    if (!bound) continue;
    const double at_start = measure(bound->head(loop_.R.rows()));
    if (!std::isfinite(at_start)) continue;
    const double samples = std::max(0.0, std::ceil(std::log(at_start / part) / std::log(sigma)));
    const auto count = static_cast<std::size_t>(std::min(samples, 1e15));
    best = best ? std::min(*best, count) : count;
  }
  return best;
}

std::optional<std::size_t> ErrorBounds::faded_after(const Start& start, const Measure& measure,
                                                    double part, std::size_t most) const {
  if (start.directions.cwiseAbs().maxCoeff() == 0.0 || start.size.maxCoeff() == 0.0) return 0;
  const std::optional<std::size_t> end = horizon(start, measure, part);
  // The horizon is a bound: some times what is looked for. Beyond that it would take too long.
  constexpr std::size_t kSlack = 10;
  if (!end || *end > kSlack * most) return std::nullopt;
  const MatrixXd course = fading(start, *end);
  std::size_t first = *end;
  while (first > 0 && measure(course.row(static_cast<Index>(first) - 1).transpose()) <= part) {
    --first;
  }
  return first <= most ? std::optional(first) : std::nullopt;
}

}  // namespace faultline

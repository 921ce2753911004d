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
// Rates of decay that are tried as bounds: powers of the spectral radius; of dead-beat observers it
// is nothing but rounding errors.
constexpr std::array kRates = {0.8, 0.65, 0.5, 0.35, 0.2, 0.1, 0.05};
constexpr double kSmallestRadius = 1e-3;
constexpr Index kFirstResponses = 256;

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
  Recursion(const ErrorBounds& bounds, Index samples)
      : G_(bounds.G_),
        terms_(bounds.loop_.terms()),
        begin_(samples * terms_),
        q_(VectorXd::Zero(begin_)) {}

  /// The next sample of the bounds, of all rows, from what they would be without Lipschitz terms.
  VectorXd next(VectorXd bound) {
    if (terms_ == 0) return bound;
    const Index count = std::min(q_.size() - begin_, G_.cols());
    bound.noalias() += G_.leftCols(count) * q_.segment(begin_, count);
    begin_ -= terms_;
    q_.segment(begin_, terms_) = bound.tail(terms_);
    return bound;
  }

 private:
  const MatrixXd& G_;
  Index terms_, begin_;
  VectorXd q_;  // from begin_ on: q of the last sample, of the one before, ..
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

  find_decays(radius);

  const Index terms = loop.terms();
  if (terms == 0) return;
  const double power = largest_power(loop.N);
  const double smallest = kNegligible * gains->maxCoeff();
  MatrixXd left = rows_;
  Index count = 0;
  G_ = MatrixXd(rows_.rows(), kFirstResponses * terms);
  while (count < kMostSamples && left.norm() * power * loop.S_E.norm() > smallest) {
    if (G_.cols() == count * terms) G_.conservativeResize(Eigen::NoChange, 2 * G_.cols());
    G_.middleCols(count * terms, terms) = (left * loop.S_E).cwiseAbs() * loop.radius.asDiagonal();
    left = (left * loop.N).eval();
    ++count;
  }
  G_.conservativeResize(Eigen::NoChange, count * terms);
}

// With σ > 1 and σN stable, σ^k |R' e_k| <= f + W q: the same small gain for the weighted error,
// f = Σ_k |R' (σN)^k ..| and W = Σ_k |R' (σN)^k σS_E| radius. So the bound falls like σ^-k.
void ErrorBounds::find_decays(double radius) {
  const Index n = loop_.n();
  MatrixXd B(n, n + loop_.terms());
  B << MatrixXd::Identity(n, n), loop_.S_E;
  for (const double rate : kRates) {
    const double sigma = std::pow(std::max(radius, kSmallestRadius), -rate);
    const std::optional<MatrixXd> sums = absolute_sum(rows_, sigma * loop_.N, B);
    if (!sums) continue;
    Decay decay{sigma, sums->leftCols(n), sigma * sums->rightCols(loop_.terms())};
    if (close(VectorXd::Zero(rows_.rows()), decay.gains)) decays_.push_back(std::move(decay));
  }
}

// b = direct + gains·diag(radius)·q, q the rows of E_i in b.
std::optional<VectorXd> ErrorBounds::close(const VectorXd& direct, const MatrixXd& gains) const {
  const Index terms = loop_.terms();
  if (terms == 0) return direct;
  const MatrixXd G = gains * loop_.radius.asDiagonal();
  const MatrixXd G_q = G.bottomRows(terms);
  if (!(spectral_radius(G_q) < 1.0)) return std::nullopt;
  const MatrixXd pencil = MatrixXd::Identity(terms, terms) - G_q;
  const VectorXd q = pencil.partialPivLu().solve(direct.tail(terms));
  return VectorXd(direct + G * q);
}

MatrixXd ErrorBounds::course(std::size_t samples) const {
  const auto count = static_cast<Index>(samples);
  const VectorXd& w = loop_.w_bound;
  MatrixXd course(count, loop_.R.rows());
  Recursion recursion(*this, count);
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
  Recursion recursion(*this, count);
  MatrixXd left = rows_;
  for (Index k = 0; k < count; ++k) {
    const VectorXd direct = (left * start.directions).cwiseAbs() * start.size;
    course.row(k) = recursion.next(direct).head(course.cols()).transpose();
    left = (left * loop_.N).eval();
  }
  return course;
}

std::optional<std::size_t> ErrorBounds::horizon(const Start& start, const Measure& measure,
                                                double part) const {
  const VectorXd error = start.directions.cwiseAbs() * start.size;
  std::optional<std::size_t> best;
  for (const Decay& decay : decays_) {
    const std::optional<VectorXd> bound = close(decay.first * error, decay.gains);
    const double at_start = measure(bound->head(loop_.R.rows()));
    if (!std::isfinite(at_start)) continue;
    const double samples = std::ceil(std::log(at_start / part) / std::log(decay.sigma));
    const auto count = static_cast<std::size_t>(std::clamp(samples, 0.0, 1e15));
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

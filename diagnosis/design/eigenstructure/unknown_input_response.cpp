#include "diagnosis/design/eigenstructure/unknown_input_response.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <Eigen/LU>
#include <Eigen/SVD>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/residual_response.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Complex = std::complex<double>;

constexpr int kPointsPerDecade = 20;
// The grid goes so far below the slowest rate and above the fastest.
constexpr double kBeyond = 100.0;
// Golden sections leave a 1e-4th of the interval: gains near a maximum are right to 1e-8.
constexpr int kGoldenSections = 20;
constexpr std::size_t kRefinedPeaks = 3;
// ‖F^(2^s)‖ of a stable F is zero to working precision before that.
constexpr int kMaxDoublings = 64;

double largest_singular_value(const MatrixXcd& T) {
  if (T.size() == 0) {
    return 0.0;
  }
  return T.cols() == 1 || T.rows() == 1 ? T.norm()
                                        : Eigen::JacobiSVD<MatrixXcd>(T).singularValues()[0];
}

// Rates of the modes: |λ|, or |log λ| for the z plane.
std::vector<double> mode_rates(const MatrixXd& F, bool is_sampled) {
  std::vector<double> rates;
  for (const Complex pole : eigenvalues(F)) {
    const double rate = is_sampled ? std::abs(std::log(pole)) : std::abs(pole);
    if (std::isfinite(rate) && rate > 0.0) {
      rates.push_back(rate);
    }
    const double ringing = std::abs(is_sampled ? std::arg(pole) : pole.imag());
    if (ringing > 0.0) {
      rates.push_back(ringing);
    }
  }
  return rates;
}

std::vector<double> frequency_grid(const MatrixXd& F, bool is_sampled) {
  std::vector<double> rates = mode_rates(F, is_sampled);
  if (rates.empty()) {
    rates.push_back(1.0);
  }
  const double lowest = *std::min_element(rates.begin(), rates.end()) / kBeyond;
  double highest = *std::max_element(rates.begin(), rates.end()) * kBeyond;
  if (is_sampled) {
    highest = std::numbers::pi;
    std::erase_if(rates, [](double rate) { return rate > std::numbers::pi; });
    rates.push_back(highest);
  }
  const double decades = std::log10(highest / std::min(lowest, highest));
  const int points = static_cast<int>(std::ceil(decades * kPointsPerDecade));
  for (int i = 0; i < points; ++i) {
    rates.push_back(lowest * std::pow(10.0, decades * i / points));
  }
  rates.push_back(0.0);
  std::sort(rates.begin(), rates.end());
  rates.erase(std::unique(rates.begin(), rates.end()), rates.end());
  return rates;
}

// Y = F Y Fᵀ + Q by doubling.
MatrixXd sum_of_powers(MatrixXd F, MatrixXd Q) {
  for (int s = 0; s < kMaxDoublings && F.norm() > 0.0; ++s) {
    const MatrixXd more = F * Q * F.transpose();
    Q += more;
    if (more.norm() <= std::numeric_limits<double>::epsilon() * Q.norm()) {
      break;
    }
    F = (F * F).eval();
  }
  return Q;
}

}  // namespace

UnknownInputResponse::UnknownInputResponse(const CompromiseTask& task, const MatrixXd& D_1)
    : is_sampled_(task.is_sampled),
      F_(task.A_0 + D_1 * task.M),
      M_(task.M),
      b_(task.unknown.state + D_1 * task.unknown.output),
      h_(task.unknown.output),
      rates_(frequency_grid(F_, is_sampled_)) {
  for (const double rate : rates_) {
    on_grid_.push_back(at(lambda_of(rate)));
  }
  find_wanted(task, D_1);
}

Complex UnknownInputResponse::lambda_of(double rate) const {
  return is_sampled_ ? std::polar(1.0, rate) : Complex(0.0, rate);
}

MatrixXcd UnknownInputResponse::at(Complex lambda) const {
  const Index d = F_.rows();
  MatrixXcd T = h_.cast<Complex>();
  if (d > 0) {
    const MatrixXcd pencil = lambda * MatrixXcd::Identity(d, d) - F_.cast<Complex>();
    T += M_.cast<Complex>() * pencil.partialPivLu().solve(b_.cast<Complex>());
  }
  return T;
}

void UnknownInputResponse::find_wanted(const CompromiseTask& task, const MatrixXd& D_1) {
  wanted_.resize(M_.rows(), task.wanted.state.cols());
  for (Index j = 0; j < wanted_.cols(); ++j) {
    const Eigen::VectorXd b = task.wanted.state.col(j) + D_1 * task.wanted.output.col(j);
    const Eigen::VectorXd h = task.wanted.output.col(j);
    const auto response = [&](double rate) -> Eigen::VectorXcd {
      const Index d = F_.rows();
      Eigen::VectorXcd T = h.cast<Complex>();
      if (d > 0) {
        const MatrixXcd pencil = lambda_of(rate) * MatrixXcd::Identity(d, d) - F_.cast<Complex>();
        T += M_.cast<Complex>() * pencil.partialPivLu().solve(b.cast<Complex>());
      }
      return T;
    };
    if (dc_gain({F_, M_, b, h, is_sampled_}) > 0.0) {
      wanted_.col(j) = response(0.0);
      continue;
    }
    double largest = -1.0;
    for (const double rate : rates_) {
      const Eigen::VectorXcd T = response(rate);
      if (T.norm() > largest) {
        largest = T.norm();
        wanted_.col(j) = T;
      }
    }
  }
}

UnknownInputResponse::Peak UnknownInputResponse::peak(const MatrixXd& Theta) const {
  const MatrixXcd weight = Theta.cast<Complex>();
  std::vector<double> gains;
  for (const MatrixXcd& T : on_grid_) {
    gains.push_back(largest_singular_value(weight * T));
  }
  std::vector<std::size_t> maxima;
  for (std::size_t i = 0; i < gains.size(); ++i) {
    const bool rises = i == 0 || gains[i] >= gains[i - 1];
    const bool falls = i + 1 == gains.size() || gains[i] >= gains[i + 1];
    if (rises && falls) {
      maxima.push_back(i);
    }
  }
  std::stable_sort(maxima.begin(), maxima.end(),
                   [&](std::size_t a, std::size_t b) { return gains[a] > gains[b]; });
  maxima.resize(std::min(maxima.size(), kRefinedPeaks));
  Peak peak;
  const auto try_rate = [&](double rate) {
    const double gain = largest_singular_value(weight * at(lambda_of(rate)));
    if (gain > peak.gain) {
      peak = {gain, lambda_of(rate)};
    }
    return gain;
  };
  for (const std::size_t i : maxima) {
    double low = rates_[i == 0 ? 0 : i - 1];
    double high = rates_[std::min(i + 1, rates_.size() - 1)];
    try_rate(rates_[i]);
    double left = high - (high - low) / std::numbers::phi;
    double right = low + (high - low) / std::numbers::phi;
    double at_left = try_rate(left);
    double at_right = try_rate(right);
    for (int s = 0; s < kGoldenSections; ++s) {
      if (at_left > at_right) {
        high = right;
        right = left;
        at_right = at_left;
        left = high - (high - low) / std::numbers::phi;
        at_left = try_rate(left);
      } else {
        low = left;
        left = right;
        at_left = at_right;
        right = low + (high - low) / std::numbers::phi;
        at_right = try_rate(right);
      }
    }
  }
  return peak;
}

MatrixXd UnknownInputResponse::covariance() const {
  const Index d = F_.rows();
  if (!is_sampled_ && !h_.isZero(0.0)) {
    return MatrixXd::Constant(M_.rows(), M_.rows(), std::numeric_limits<double>::infinity());
  }
  if (d == 0) {
    return h_ * h_.transpose();
  }
  if (is_sampled_) {
    const MatrixXd Y = sum_of_powers(F_, b_ * b_.transpose());
    return M_ * Y * M_.transpose() + h_ * h_.transpose();
  }
  // The same Y after a Cayley transform: F_c = (α I - F)⁻¹ (α I + F), b_c = √(2α) (α I - F)⁻¹ b.
  const double alpha = F_.norm();
  const MatrixXd I = MatrixXd::Identity(d, d);
  const Eigen::PartialPivLU<MatrixXd> shifted(alpha * I - F_);
  const MatrixXd b_c = std::sqrt(2.0 * alpha) * shifted.solve(b_);
  const MatrixXd Y = sum_of_powers(shifted.solve(alpha * I + F_), b_c * b_c.transpose());
  return M_ * Y * M_.transpose();
}

}  // namespace faultline

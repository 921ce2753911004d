#include "diagnosis/design/innovation_spectrum.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Complex = std::complex<double>;

// Samples per window: 128 frequencies tell a spectrum of a few modes, and short records still have
// windows enough.
constexpr Index kWindow = 256;
// Turns of E and s at most, and the gain of likelihood that ends them.
constexpr int kMostTurns = 200;
constexpr double kSettled = 1e-3;
// And that part of it, near which rounding errors of its sums are.
constexpr double kRounding = 1e-9;
// Steps of the BFGS method in a turn, and halvings of one until it gains.
constexpr int kSteps = 15;
constexpr int kHalvings = 30;
// Frequencies that share one value of d's spectrum: were each free, an E could hide behind it.
constexpr std::size_t kBand = 8;
// Updates of the spectrum in a turn.
constexpr int kSpectrumUpdates = 3;
// Spectra are kept this far above zero, where their updates would end.
constexpr double kLeastSpectrum = 1e-9;

// S += X Xᴴ per frequency of one window, X its discrete Fourier transform.
void add_window(const MatrixXd& e, const VectorXd& window, std::vector<MatrixXcd>& S) {
  for (std::size_t i = 0; i < S.size(); ++i) {
    const double angle =
        2.0 * std::numbers::pi * static_cast<double>(i + 1) / static_cast<double>(kWindow);
    Eigen::VectorXcd X = Eigen::VectorXcd::Zero(e.rows());
    const Complex turn = std::polar(1.0, -angle);
    Complex phase = 1.0;
    for (Index k = 0; k < e.cols(); ++k) {
      X += (window[k] * phase) * e.col(k);
      phase *= turn;
    }
    S[i] += X * X.adjoint();
  }
}

}  // namespace

InnovationSpectrum::InnovationSpectrum(const InnovationModel& model,
                                       const std::vector<MatrixXd>& segments)
    : n_(model.F.rows()) {
  const Index n = model.F.rows();
  const Index q = model.C.rows();
  constexpr std::size_t kFrequencies = kWindow / 2 - 1;  // neither DC nor half the sample rate
  S_.assign(kFrequencies, MatrixXcd::Zero(q, q));
  VectorXd window(kWindow);  // Hann, of unit power
  for (Index k = 0; k < kWindow; ++k) {
    window[k] = 0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (static_cast<double>(k) + 0.5) /
                                     static_cast<double>(kWindow));
  }
  window /= window.norm();
  std::size_t averaged = 0;
  for (const MatrixXd& segment : segments) {
    for (Index at = 0; at + kWindow <= segment.cols(); at += kWindow / 2) {
      add_window(segment.middleCols(at, kWindow), window, S_);
      windows_ += 0.5;  // each shares half of its samples with the next
      ++averaged;
    }
  }
  if (averaged == 0) {
    return;
  }
  for (std::size_t i = 0; i < kFrequencies; ++i) {
    S_[i] /= static_cast<double>(averaged);
    const double angle =
        2.0 * std::numbers::pi * static_cast<double>(i + 1) / static_cast<double>(kWindow);
    const MatrixXcd pencil =
        std::polar(1.0, angle) * MatrixXcd::Identity(n, n) - model.F.cast<Complex>();
    const MatrixXcd G =
        pencil.transpose().partialPivLu().solve(model.C.transpose().cast<Complex>()).transpose();
    const MatrixXcd V = MatrixXcd::Identity(q, q) - G * model.L.cast<Complex>();
    G_.push_back(G);
    noise_.push_back(V * model.R.cast<Complex>() * V.adjoint());
  }
}

MatrixXd InnovationSpectrum::Fit::covariance() const { return s.mean() * E * E.transpose(); }

InnovationSpectrum::Value InnovationSpectrum::value(const MatrixXd& E, const VectorXd& s) const {
  Value result{0.0, MatrixXd::Zero(E.rows(), E.cols())};
  for (std::size_t i = 0; i < G_.size(); ++i) {
    const MatrixXcd GE = G_[i] * E.cast<Complex>();
    const double s_i = s[static_cast<Index>(i)];
    const MatrixXcd Sigma = s_i * GE * GE.adjoint() + noise_[i];
    const Eigen::LLT<MatrixXcd> factor(Sigma);
    const MatrixXcd root = factor.matrixL();
    const MatrixXcd weighted = factor.solve(S_[i]);  // Σ⁻¹ S
    result.log_likelihood -=
        2.0 * root.diagonal().real().array().log().sum() + weighted.trace().real();
    // d/dE: -2 Re [s Gᴴ (Σ⁻¹ - Σ⁻¹ S Σ⁻¹) G E]
    const MatrixXcd towards = factor.solve(GE) - weighted * factor.solve(GE);
    result.gradient -= 2.0 * s_i * (G_[i].adjoint() * towards).real();
  }
  result.log_likelihood *= 0.5 * windows_;
  result.gradient *= 0.5 * windows_;
  return result;
}

InnovationSpectrum::Fit InnovationSpectrum::without() const {
  Fit fit{MatrixXd(n_, 0), VectorXd::Ones(static_cast<Index>(G_.size()))};
  fit.log_likelihood = value(fit.E, fit.s).log_likelihood;
  return fit;
}

void InnovationSpectrum::improve_spectrum(Fit& fit) const {
  for (int update = 0; update < kSpectrumUpdates; ++update) {
    for (std::size_t band = 0; band < G_.size(); band += kBand) {
      double expected = 0.0;
      double found = 0.0;
      const std::size_t end = std::min(band + kBand, G_.size());
      for (std::size_t i = band; i < end; ++i) {
        const MatrixXcd GE = G_[i] * fit.E.cast<Complex>();
        const Eigen::LLT<MatrixXcd> factor(fit.s[static_cast<Index>(i)] * GE * GE.adjoint() +
                                           noise_[i]);
        const MatrixXcd of_E = factor.solve(GE);
        expected += (GE.adjoint() * of_E).trace().real();
        found += (of_E.adjoint() * S_[i] * of_E).trace().real();
      }
      if (expected > 0.0) {
        auto s = fit.s.segment(static_cast<Index>(band), static_cast<Index>(end - band));
        s = (s * std::sqrt(found / expected)).cwiseMax(kLeastSpectrum).eval();
      }
    }
  }
  // s E Eᵀ is what counts: s has the mean one.
  const double mean = fit.s.mean();
  fit.s /= mean;
  fit.E *= std::sqrt(mean);
}

void InnovationSpectrum::improve_directions(Fit& fit) const {
  const Index size = fit.E.size();
  MatrixXd inverse_hessian = MatrixXd::Identity(size, size);
  Value at = value(fit.E, fit.s);
  bool is_first = true;
  for (int step = 0; step < kSteps; ++step) {
    const VectorXd gradient = at.gradient.reshaped();
    VectorXd direction = inverse_hessian * gradient;
    if (is_first) {  // no scale is known yet: a hundredth of E
      direction *= 0.01 * fit.E.norm() / std::max(direction.norm(), 1e-300);
    }
    Value next;
    MatrixXd moved;
    double length = 1.0;
    for (int halving = 0; halving < kHalvings; ++halving, length *= 0.5) {
      moved = fit.E + length * direction.reshaped(fit.E.rows(), fit.E.cols());
      next = value(moved, fit.s);
      if (next.log_likelihood > at.log_likelihood) {
        break;
      }
    }
    if (!(next.log_likelihood > at.log_likelihood)) {
      break;
    }
    const VectorXd y = gradient - next.gradient.reshaped();
    const VectorXd p = (moved - fit.E).reshaped();
    if (const double curvature = p.dot(y); curvature > 0.0) {
      if (is_first) {
        inverse_hessian *= curvature / y.squaredNorm();
      }
      const MatrixXd I = MatrixXd::Identity(size, size);
      const MatrixXd left = I - p * y.transpose() / curvature;
      inverse_hessian =
          (left * inverse_hessian * left.transpose() + p * p.transpose() / curvature).eval();
      is_first = false;
    }
    fit.E = moved;
    at = next;
  }
  fit.log_likelihood = at.log_likelihood;
}

InnovationSpectrum::Fit InnovationSpectrum::most_likely(const MatrixXd& E) const {
  Fit fit{E, VectorXd::Ones(static_cast<Index>(G_.size()))};
  double before = -std::numeric_limits<double>::infinity();
  for (int turn = 0; turn < kMostTurns; ++turn) {
    improve_directions(fit);
    improve_spectrum(fit);
    fit.log_likelihood = value(fit.E, fit.s).log_likelihood;
    if (fit.log_likelihood - before < kSettled + kRounding * std::abs(fit.log_likelihood)) {
      break;
    }
    before = fit.log_likelihood;
  }
  return fit;
}

VectorXd InnovationSpectrum::steepest(const Fit& fit) const {
  MatrixXd second = MatrixXd::Zero(n_, n_);
  for (std::size_t i = 0; i < G_.size(); ++i) {
    const MatrixXcd GE = G_[i] * fit.E.cast<Complex>();
    const double s = fit.s[static_cast<Index>(i)];
    const Eigen::LLT<MatrixXcd> factor(s * GE * GE.adjoint() + noise_[i]);
    const MatrixXcd of_G = factor.solve(G_[i]);
    second += s * (of_G.adjoint() * S_[i] * of_G - G_[i].adjoint() * of_G).real();
  }
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(0.5 * (second + second.transpose()));
  return solver.eigenvectors().col(n_ - 1);
}

}  // namespace faultline

#include "diagnosis/certify/quadratic_bound.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <fmt/format.h>

#include "diagnosis/certify/spectra.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kInequality = 1e-8;
// P is symmetric but for the last digits of its file.
constexpr double kSymmetry = 1e-12;

void check_claims(const ObserverLoop& loop, const ObserverCertificate& claims,
                  const MatrixXd& weight) {
  const Index n = loop.n(), s = loop.w_bound.size(), rows = loop.R.rows();
  if (!(claims.alpha > 0.0 && claims.alpha < 1.0)) {
    throw std::invalid_argument(
        fmt::format("found alpha = {:g}, expected a number between 0 and 1", claims.alpha));
  }
  if (claims.P.rows() != n || claims.P.cols() != n || !claims.P.allFinite() ||
      (claims.P - claims.P.transpose()).norm() > kSymmetry * claims.P.norm()) {
    throw std::invalid_argument(
        fmt::format("found P of {}x{} numbers, expected a symmetric matrix of {}x{} finite ones",
                    claims.P.rows(), claims.P.cols(), n, n));
  }
  for (const auto& [name, mu] :
       {std::pair("mu_now", &claims.mu_now), std::pair("mu_next", &claims.mu_next),
        std::pair("mu_direct", &claims.mu_direct)}) {
    if (mu->size() != s || !mu->allFinite() || (s > 0 && mu->minCoeff() < 0.0)) {
      throw std::invalid_argument(
          fmt::format("found {} numbers as {}, expected {}, none negative: one per disturbance, "
                      "noise and fault "
                      "carried as a state",
                      mu->size(), name, s));
    }
  }
  if (weight.rows() != rows || weight.cols() != rows || !weight.allFinite()) {
    throw std::invalid_argument(
        fmt::format("found a weight of {}x{} numbers, expected {}x{} finite "
                    "ones",
                    weight.rows(), weight.cols(), rows, rows));
  }
}

// Largest λ of Xᵀ P X v = λ diag(P_now, diag(mu)) v, X = [A B]: columns of B that are zero drop
// out, others with μ = 0 have no bound.
double largest_ratio(const MatrixXd& A, const MatrixXd& B, const MatrixXd& P_next,
                     const MatrixXd& P_now, const VectorXd& mu) {
  const Index n = A.cols();
  std::vector<Index> kept;
  for (Index i = 0; i < B.cols(); ++i) {
    if (B.col(i).cwiseAbs().maxCoeff() == 0.0) continue;
    if (mu[i] == 0.0) return std::numeric_limits<double>::infinity();
    kept.push_back(i);
  }
  const Index total = n + std::ssize(kept);
  const Eigen::LLT<MatrixXd> now(P_now);
  // X diag(L⁻ᵀ, μ^-1/2)
  MatrixXd X(A.rows(), total);
  X.leftCols(n) = now.matrixL().solve(A.transpose()).transpose();
  for (Index i = 0; i < std::ssize(kept); ++i) {
    const Index column = kept[static_cast<std::size_t>(i)];
    X.col(n + i) = B.col(column) / std::sqrt(mu[column]);
  }
  const Eigen::LLT<MatrixXd> next(P_next);
  const MatrixXd Y = next.matrixU() * X;
  return largest_eigenvalue(Y.transpose() * Y);
}

double weighted_squares(const VectorXd& mu, const VectorXd& bound) {
  return mu.dot(bound.cwiseAbs2());
}

}  // namespace

bool QuadraticBound::is_proved() const {
  return dynamic_eigenvalue <= 1.0 + kInequality && output_eigenvalue <= 1.0 + kInequality;
}

double QuadraticBound::at(std::size_t k) const {
  const double left = std::pow(alpha, static_cast<double>(k));
  return std::sqrt(left * start + (1.0 - left) * later + direct);
}

double QuadraticBound::limit() const { return std::sqrt(later + direct); }

double QuadraticBound::start_over_after(double part) const {
  const double ratio = start / (part * (later + direct));
  return ratio > 1.0 ? std::ceil(-std::log(ratio) / std::log(alpha)) : 0.0;
}

QuadraticBound quadratic_bound(const ObserverLoop& loop, const ObserverCertificate& claims,
                               const MatrixXd& weight) {
  check_claims(loop, claims, weight);
  if (Eigen::LLT<MatrixXd>(claims.P).info() != Eigen::Success) {
    throw std::invalid_argument("found a P that is not positive definite, expected one that is");
  }
  QuadraticBound bound;
  bound.alpha = claims.alpha;
  const Index s = loop.w_bound.size();
  MatrixXd B(loop.n(), 2 * s);
  B << loop.B_now, loop.B_next;
  VectorXd mu(2 * s);
  mu << claims.mu_now, claims.mu_next;
  mu *= 1.0 - claims.alpha;
  for (Index vertex = 0; vertex < loop.vertex_count(); ++vertex) {
    bound.dynamic_eigenvalue =
        std::max(bound.dynamic_eigenvalue,
                 largest_ratio(loop.at_vertex(vertex), B, claims.P, claims.alpha * claims.P, mu));
  }
  const MatrixXd X = MatrixXd::Identity(weight.rows(), weight.cols());
  bound.output_eigenvalue =
      largest_ratio(weight * loop.R, weight * loop.Q, X, claims.P, claims.mu_direct);
  bound.start = largest_eigenvalue(claims.P) * loop.e_bound.squaredNorm();
  bound.later = weighted_squares(claims.mu_now + claims.mu_next, loop.w_bound);
  bound.direct = weighted_squares(claims.mu_direct, loop.w_bound);
  return bound;
}

}  // namespace faultline

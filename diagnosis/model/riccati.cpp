#include "diagnosis/model/riccati.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <fmt/format.h>

namespace faultline {
namespace {

using Eigen::MatrixXd;

// Doubling squares the closed loop each time: 60 steps see poles up to 1 - 2^-60.
constexpr int kMaxDoublings = 60;
// Change of X at which doubling has reached rounding error: a few units in the last place.
constexpr double kConverged = 1e-15;
// Largest accepted relative residual of the equation: rounding error grows with the condition of
// (X, closed loop); 1e-8 still leaves half of the digits.
constexpr double kMaxResidual = 1e-8;
// Keeps the Cayley transform of a zero matrix defined.
constexpr double kSmallestShift = 1e-100;

void check_shapes(const MatrixXd& A, const MatrixXd& B, const MatrixXd& Q, const MatrixXd& R) {
  const auto n = A.rows();
  const auto m = B.cols();
  if (A.cols() != n || B.rows() != n || Q.rows() != n || Q.cols() != n || R.rows() != m ||
      R.cols() != m || n == 0 || m == 0) {
    throw std::invalid_argument(fmt::format(
        "Riccati equation: found A {}x{}, B {}x{}, Q {}x{}, R {}x{}, expected A n x n, "
        "B n x m, Q n x n, R m x m",
        A.rows(), A.cols(), B.rows(), B.cols(), Q.rows(), Q.cols(), R.rows(), R.cols()));
  }
}

MatrixXd gain(const MatrixXd& A, const MatrixXd& B, const MatrixXd& X, const MatrixXd& R) {
  return (R + B.transpose() * X * B).llt().solve(B.transpose() * X * A);
}

// Whether the powers of F vanish, i.e. its spectral radius is below 1 (by more than rounding).
bool is_contraction(MatrixXd F) {
  for (int i = 0; i < kMaxDoublings && F.allFinite(); ++i) {
    if (F.norm() < 1.0) {
      return true;
    }
    F = (F * F).eval();
  }
  return false;
}

MatrixXd input_weight(const MatrixXd& B, const MatrixXd& R) {
  const Eigen::LLT<MatrixXd> R_factor(R);
  if (R_factor.info() != Eigen::Success) {
    throw std::invalid_argument("Riccati equation: found R not positive definite");
  }
  return B * R_factor.solve(B.transpose());
}

// Structure-preserving doubling from (A, G, H) to X.
MatrixXd double_up(MatrixXd A_k, MatrixXd G_k, MatrixXd H_k) {
  // A_k+1 = A W⁻¹ A, G_k+1 = G + A W⁻¹ G Aᵀ, H_k+1 = H + Aᵀ H W⁻¹ A with W = I + G H; H_k → X.
  const MatrixXd I = MatrixXd::Identity(A_k.rows(), A_k.cols());
  for (int i = 0; i < kMaxDoublings; ++i) {
    const Eigen::PartialPivLU<MatrixXd> W(I + G_k * H_k);
    const MatrixXd W_A = W.solve(A_k);
    const MatrixXd W_G = W.solve(G_k);
    const MatrixXd change = A_k.transpose() * H_k * W_A;
    const MatrixXd H_next = H_k + change;
    const MatrixXd G_next = G_k + A_k * W_G * A_k.transpose();
    H_k = 0.5 * (H_next + H_next.transpose());
    G_k = 0.5 * (G_next + G_next.transpose());
    A_k = (A_k * W_A).eval();
    if (!(change.norm() > kConverged * H_k.norm())) {
      break;
    }
  }
  return H_k;
}

void check_solution(const MatrixXd& A, const MatrixXd& B, const MatrixXd& Q, const MatrixXd& R,
                    const MatrixXd& X) {
  if (!X.allFinite()) {
    throw std::invalid_argument(
        "Riccati equation: no stabilising solution, is (A, B) stabilisable?");
  }
  const MatrixXd K = gain(A, B, X, R);
  const MatrixXd closed_loop = A - B * K;
  const MatrixXd image = A.transpose() * X * closed_loop + Q;
  const double residual = (image - X).norm() / std::max(X.norm(), Q.norm());
  if (!(residual <= kMaxResidual) || !is_contraction(closed_loop)) {
    throw std::invalid_argument(
        fmt::format("Riccati equation: no stabilising solution (relative residual {:.1e}), is "
                    "(A, B) stabilisable?",
                    residual));
  }
}

void check_continuous_solution(const MatrixXd& A, const MatrixXd& G, const MatrixXd& Q,
                               const MatrixXd& X) {
  const MatrixXd closed_loop = A - G * X;
  const MatrixXd XA = X * A;
  const double size = std::max({XA.norm(), (X * G * X).norm(), Q.norm()});
  const double residual = (XA + XA.transpose() - X * G * X + Q).norm() / size;
  // Stable iff its Cayley transform is a contraction.
  const MatrixXd I = MatrixXd::Identity(A.rows(), A.cols());
  const double gamma = closed_loop.norm() + kSmallestShift;
  if (!X.allFinite() || !(residual <= kMaxResidual) ||
      !is_contraction((gamma * I - closed_loop).partialPivLu().solve(gamma * I + closed_loop))) {
    throw std::invalid_argument(
        fmt::format("Riccati equation: no stabilising solution (relative residual {:.1e}), is "
                    "(A, B) stabilisable?",
                    residual));
  }
}

}  // namespace

MatrixXd solve_dare(const MatrixXd& A, const MatrixXd& B, const MatrixXd& Q, const MatrixXd& R) {
  check_shapes(A, B, Q, R);
  const MatrixXd X = double_up(A, input_weight(B, R), Q);
  check_solution(A, B, Q, R, X);
  return X;
}

MatrixXd solve_care(const MatrixXd& A, const MatrixXd& B, const MatrixXd& Q, const MatrixXd& R) {
  check_shapes(A, B, Q, R);
  const MatrixXd G = input_weight(B, R);
  const MatrixXd I = MatrixXd::Identity(A.rows(), A.cols());
  // Any γ > 0 that keeps A - γ I away from singular serves; this one lies right of all eigenvalues.
  const double gamma = A.norm() + std::sqrt(G.norm() * Q.norm()) + kSmallestShift;
  const Eigen::PartialPivLU<MatrixXd> A_gamma(A - gamma * I);
  const MatrixXd A_inverse_G = A_gamma.solve(G);
  const Eigen::PartialPivLU<MatrixXd> W((A - gamma * I).transpose() + Q * A_inverse_G);
  const MatrixXd W_inverse = W.inverse();
  const MatrixXd X =
      double_up(I + 2.0 * gamma * W_inverse.transpose(), 2.0 * gamma * A_inverse_G * W_inverse,
                2.0 * gamma * W_inverse * Q * A_gamma.inverse());
  check_continuous_solution(A, G, Q, X);
  return X;
}

MatrixXd lqr_gain(const MatrixXd& A, const MatrixXd& B, const MatrixXd& Q, const MatrixXd& R) {
  return gain(A, B, solve_dare(A, B, Q, R), R);
}

}  // namespace faultline

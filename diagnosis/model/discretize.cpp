#include "diagnosis/model/discretize.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

#include <Eigen/LU>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// exp(A) by scaling and squaring with the [13/13] Padé approximant: N. J. Higham, SIAM J. Matrix
// Anal. Appl. 26 (2005) 1179-1193, algorithm 2.3 with m = 13 throughout.
MatrixXd matrix_exponential(const MatrixXd& A) {
  // Coefficients b_0..b_13 of the approximant, ibid. equation (2.2).
  constexpr std::array<double, 14> kB = {64764752532480000.0,
                                         32382376266240000.0,
                                         7771770303897600.0,
                                         1187353796428800.0,
                                         129060195264000.0,
                                         10559470521600.0,
                                         670442572800.0,
                                         33522128640.0,
                                         1323241920.0,
                                         40840800.0,
                                         960960.0,
                                         16380.0,
                                         182.0,
                                         1.0};
  // Largest norm for which the approximant is accurate to the last bit, ibid. table 2.3.
  constexpr double kTheta13 = 5.371920351148152;

  const double norm = A.cwiseAbs().colwise().sum().maxCoeff();
  const int squarings =
      norm > kTheta13 ? static_cast<int>(std::ceil(std::log2(norm / kTheta13))) : 0;
  const MatrixXd X = A * std::ldexp(1.0, -squarings);
  const MatrixXd I = MatrixXd::Identity(A.rows(), A.cols());
  const MatrixXd X2 = X * X;
  const MatrixXd X4 = X2 * X2;
  const MatrixXd X6 = X4 * X2;
  const MatrixXd odd = X * (X6 * (kB[13] * X6 + kB[11] * X4 + kB[9] * X2) + kB[7] * X6 +
                            kB[5] * X4 + kB[3] * X2 + kB[1] * I);
  const MatrixXd even = X6 * (kB[12] * X6 + kB[10] * X4 + kB[8] * X2) + kB[6] * X6 + kB[4] * X4 +
                        kB[2] * X2 + kB[0] * I;
  MatrixXd result = (even - odd).partialPivLu().solve(even + odd);
  for (int i = 0; i < squarings; ++i) {
    result = (result * result).eval();
  }
  return result;
}

// Powers of two by which to measure the columns of B·T: sampling is linear in them, and columns
// larger than A·T would cost A the digits of as many squarings. Small ones stay as they are.
Eigen::VectorXd column_units(const MatrixXd& B, double sample_time_s) {
  Eigen::VectorXd units = Eigen::VectorXd::Ones(B.cols());
  for (Index j = 0; j < B.cols(); ++j) {
    const double size = B.col(j).cwiseAbs().sum() * sample_time_s;
    if (size > 1.0 && std::isfinite(size)) {
      units[j] = std::exp2(std::ceil(std::log2(size)));
    }
  }
  return units;
}

}  // namespace

SampledSystem discretize_zoh(const MatrixXd& A, const MatrixXd& B, double sample_time_s) {
  assert(A.rows() == A.cols() && B.rows() == A.rows() && sample_time_s > 0.0);
  const Index n = A.rows();
  const Index m = B.cols();
  MatrixXd extended = MatrixXd::Zero(n + m, n + m);
  extended.topLeftCorner(n, n) = A * sample_time_s;
  const Eigen::VectorXd units = column_units(B, sample_time_s);
  extended.topRightCorner(n, m) = B * sample_time_s * units.cwiseInverse().asDiagonal();
  if (extended.size() == 0) {
    return {A, B};
  }
  const MatrixXd exponential = matrix_exponential(extended);
  return {exponential.topLeftCorner(n, n), exponential.topRightCorner(n, m) * units.asDiagonal()};
}

SampledSystem discretize_euler(const MatrixXd& A, const MatrixXd& B, double sample_time_s) {
  assert(A.rows() == A.cols() && B.rows() == A.rows() && sample_time_s > 0.0);
  return {MatrixXd::Identity(A.rows(), A.cols()) + A * sample_time_s, B * sample_time_s};
}

FirstOrderHoldSystem discretize_foh(const MatrixXd& A, const MatrixXd& B, double sample_time_s) {
  assert(A.rows() == A.cols() && B.rows() == A.rows() && sample_time_s > 0.0);
  const Index n = A.rows();
  const Index m = B.cols();
  // Van Loan's trick with one more integrator: v ramps from v_k to v_k+1 over one sample.
  MatrixXd extended = MatrixXd::Zero(n + 2 * m, n + 2 * m);
  extended.topLeftCorner(n, n) = A * sample_time_s;
  const Eigen::VectorXd units = column_units(B, sample_time_s);
  extended.block(0, n, n, m) = B * sample_time_s * units.cwiseInverse().asDiagonal();
  extended.block(n, n + m, m, m).setIdentity();
  if (extended.size() == 0) {
    return {A, B, B};
  }
  const MatrixXd exponential = matrix_exponential(extended);
  const MatrixXd step = exponential.block(0, n, n, m) * units.asDiagonal();
  const MatrixXd ramp = exponential.block(0, n + m, n, m) * units.asDiagonal();
  return {exponential.topLeftCorner(n, n), step - ramp, ramp};
}

}  // namespace faultline

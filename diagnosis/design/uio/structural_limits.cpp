#include "diagnosis/design/uio/structural_limits.h"

#include <cmath>

#include <Eigen/SVD>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/subspace.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Complex = std::complex<double>;

// A mode this near to the unit circle takes 1e6 samples to decay: no bound can wait for it.
constexpr double kNearlyUnstable = 1e-6;
constexpr int kAngles = 33;

// Smallest singular value of X below the tolerance, and its right singular vector.
struct Nullness {
  bool is_null = false;
  Eigen::VectorXcd vector;
};

Nullness nullness(const MatrixXcd& X, double scale) {
  const Eigen::JacobiSVD<MatrixXcd> svd(X, Eigen::ComputeFullV);
  const bool is_wide = X.rows() < X.cols();
  const double smallest = is_wide ? 0.0 : svd.singularValues()[X.cols() - 1];
  return {smallest <= kRankTolerance * scale, svd.matrixV().rightCols(1)};
}

std::optional<Complex> fixed_mode_of(const MatrixXd& A, const MatrixXd& C) {
  const Index n = A.rows();
  const double scale = A.norm() + C.norm();
  for (const Complex lambda : eigenvalues(A)) {
    if (std::abs(lambda) < 1.0 - kNearlyUnstable) continue;
    MatrixXcd pencil(n + C.rows(), n);
    pencil << lambda * MatrixXcd::Identity(n, n) - A.cast<Complex>(), C.cast<Complex>();
    if (nullness(pencil, scale).is_null) return lambda;
  }
  return std::nullopt;
}

}  // namespace

std::optional<FixedMode> fixed_mode(const ObserverModel& model,
                                    const DecouplingMatrices& decoupling) {
  if (const auto lambda = fixed_mode_of(decoupling.S * model.A, model.C)) {
    return FixedMode{*lambda, -1};
  }
  for (Index v = 0; v < model.vertex_count() && model.slope_radius.size() > 0; ++v) {
    if (const auto lambda = fixed_mode_of(decoupling.S * (model.A + model.vertex(v)), model.C)) {
      return FixedMode{*lambda, v};
    }
  }
  return std::nullopt;
}

std::optional<HiddenFault> hidden_fault(const ObserverModel& model,
                                        const DecouplingMatrices& decoupling,
                                        const FrequencyBand& band) {
  const Index n = model.n();
  const Index f = model.F_x.cols();
  const MatrixXd S_A = decoupling.S * model.A;
  const MatrixXd S_F = decoupling.S * model.F_x;
  const MatrixXd T_F = decoupling.T * model.F_y;
  // Faults count in the size of their own columns: a small one is not hidden.
  Eigen::VectorXd size(f);
  for (Index j = 0; j < f; ++j) {
    size[j] = std::max(S_F.col(j).norm(), model.F_y.col(j).norm());
    if (size[j] <= kRankTolerance * (model.F_x.col(j).norm() + model.F_y.col(j).norm())) {
      HiddenFault hidden{band.low_rad, Eigen::VectorXcd::Unit(f, j), Eigen::VectorXcd::Zero(n)};
      return hidden;
    }
  }
  for (int i = 0; i < kAngles; ++i) {
    const double angle = band.low_rad + (band.high_rad - band.low_rad) * i / (kAngles - 1);
    const Complex z = std::polar(1.0, angle);
    MatrixXcd pencil(n + model.C.rows(), n + f);
    pencil.topLeftCorner(n, n) = z * MatrixXcd::Identity(n, n) - S_A.cast<Complex>();
    pencil.topRightCorner(n, f) = z * T_F.cast<Complex>() - S_F.cast<Complex>();
    pencil.bottomLeftCorner(model.C.rows(), n) = model.C.cast<Complex>();
    pencil.bottomRightCorner(model.C.rows(), f) = model.F_y.cast<Complex>();
    for (Index j = 0; j < f; ++j) pencil.col(n + j) /= size[j];
    const Nullness found = nullness(pencil, 1.0 + S_A.norm() + model.C.norm());
    if (!found.is_null) continue;
    HiddenFault hidden{angle, found.vector.tail(f).cwiseQuotient(size.cast<Complex>()),
                       found.vector.head(n)};
    Index largest = 0;
    if (!(hidden.m.cwiseAbs().maxCoeff(&largest) > 0.0)) continue;
    const Complex unit = hidden.m[largest];
    hidden.m /= unit;
    hidden.e /= unit;
    return hidden;
  }
  return std::nullopt;
}

}  // namespace faultline

#include "diagnosis/design/geometric.h"

#include <algorithm>
#include <cassert>
#include <utility>

#include "diagnosis/design/pole_placement.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Entries of H and E below this fraction of the largest are rounding errors of exact zeros; without
// them a residual would seem to use channels that it does not use.
constexpr double kRoundingError = 1e-13;

// ‖X‖_F, or 1 for a zero X: what X is measured by.
double scale_of(const MatrixXd& X) {
  const double norm = X.norm();
  return norm > 0.0 ? norm : 1.0;
}

MatrixXd side_by_side(const MatrixXd& X, const MatrixXd& Y) {
  MatrixXd both(X.rows(), X.cols() + Y.cols());
  both << X, Y;
  return both;
}

MatrixXd stacked(const MatrixXd& X, const MatrixXd& Y) {
  MatrixXd both(X.rows() + Y.rows(), X.cols());
  both << X, Y;
  return both;
}

MatrixXd unit_columns(const MatrixXd& X) {
  MatrixXd unit = X;
  for (Index j = 0; j < X.cols(); ++j) {
    unit.col(j) /= scale_of(X.col(j));
  }
  return unit;
}

MatrixXd without_rounding_errors(const MatrixXd& X) {
  const double floor = X.size() == 0 ? 0.0 : kRoundingError * X.cwiseAbs().maxCoeff();
  return (X.array().abs() > floor).select(X, 0.0);
}

// Plant with a state for every ignored direction that reaches the output.
struct ExtendedPlant {
  Index added = 0;  // states behind the plant's own
  MatrixXd A, C, L;
};

ExtendedPlant extend(const MatrixXd& A, const MatrixXd& C, const Directions& ignored) {
  const Index n = A.rows();
  const auto reaches_output = [&](Index j) { return !ignored.output.col(j).isZero(0.0); };
  ExtendedPlant plant;
  for (Index j = 0; j < ignored.state.cols(); ++j) {
    plant.added += reaches_output(j) ? 1 : 0;
  }
  const Index total = n + plant.added;
  plant.A = MatrixXd::Zero(total, total);
  plant.A.topLeftCorner(n, n) = A;
  plant.C = MatrixXd::Zero(C.rows(), total);
  plant.C.leftCols(n) = C;
  plant.L = MatrixXd::Zero(total, ignored.state.cols());
  Index next = n;
  for (Index j = 0; j < ignored.state.cols(); ++j) {
    if (!reaches_output(j)) {
      plant.L.col(j).head(n) = ignored.state.col(j);
      continue;
    }
    // The unit of m_j is free: its columns get the size of A and C.
    const double unit = std::max(ignored.state.col(j).norm() / scale_of(A),
                                 ignored.output.col(j).norm() / scale_of(C));
    plant.A.col(next).head(n) = ignored.state.col(j) / unit;
    plant.C.col(next) = ignored.output.col(j) / unit;
    plant.L(next, j) = 1.0;
    ++next;
  }
  return plant;
}

// Rows of H: orthonormal basis of (C S)^⊥ within Im [C, D of all faults].
MatrixXd residual_outputs(const MatrixXd& C, const MatrixXd& fault_outputs, const MatrixXd& CS,
                          double scale, SubspaceArithmetic& arithmetic) {
  const MatrixXd reached =
      arithmetic.image(side_by_side(C / scale_of(C), unit_columns(fault_outputs)), 1.0);
  const MatrixXd blind = arithmetic.image(CS, scale);
  const MatrixXd basis = reached * arithmetic.kernel(blind.transpose() * reached, 1.0);
  return without_rounding_errors(canonical_rows(basis * basis.transpose(), basis.cols()));
}

}  // namespace

UnobservabilitySubspaces unobservability_subspaces(const MatrixXd& A, const MatrixXd& C,
                                                   const MatrixXd& L,
                                                   SubspaceArithmetic& arithmetic) {
  const MatrixXd A_unit = A / scale_of(A);
  const MatrixXd C_unit = C / scale_of(C);
  const MatrixXd L_basis = arithmetic.image(unit_columns(L), 1.0);

  // In exact arithmetic W grows and S shrinks until they stop. On data whose ranks flip with
  // rounding they would not: a step in the wrong direction ends the sequence, too, after at most n
  // steps.
  UnobservabilitySubspaces result;
  result.W = L_basis;
  for (;;) {
    const MatrixXd unseen = result.W * arithmetic.kernel(C_unit * result.W, 1.0);
    MatrixXd next = arithmetic.sum(L_basis, A_unit * unseen);
    if (next.cols() <= result.W.cols()) {
      break;
    }
    result.W = std::move(next);
  }
  result.S = MatrixXd::Identity(A.rows(), A.rows());
  for (;;) {
    const MatrixXd leaves = complement(result.S).transpose() * A_unit;
    MatrixXd next = arithmetic.sum(result.W, arithmetic.kernel(stacked(leaves, C_unit), 1.0));
    if (next.cols() >= result.S.cols()) {
      break;
    }
    result.S = std::move(next);
  }
  return result;
}

GeometricQuotient geometric_quotient(const MatrixXd& A, const MatrixXd& C,
                                     const Directions& ignored, const Directions& visible) {
  assert(ignored.state.rows() == A.rows() && ignored.output.rows() == C.rows());
  const Index n = A.rows();
  const ExtendedPlant plant = extend(A, C, ignored);
  SubspaceArithmetic arithmetic;
  const UnobservabilitySubspaces spaces =
      unobservability_subspaces(plant.A, plant.C, plant.L, arithmetic);

  GeometricQuotient quotient;
  quotient.dim_w = spaces.W.cols() - plant.added;
  quotient.dim_s = spaces.S.cols() - plant.added;
  // W* and S* contain the added states: on the plant's own states they project as themselves.
  quotient.projector_w = (spaces.W * spaces.W.transpose()).topLeftCorner(n, n);
  quotient.projector_s = (spaces.S * spaces.S.transpose()).topLeftCorner(n, n);
  quotient.P = canonical_rows(MatrixXd::Identity(n, n) - quotient.projector_s, n - quotient.dim_s);

  const MatrixXd CS = plant.C * spaces.S;
  const double scale = scale_of(plant.C);
  quotient.H = residual_outputs(C, visible.output, CS, scale, arithmetic);
  quotient.M = quotient.H * C * quotient.P.transpose();
  const MatrixXd PAS = quotient.P * (plant.A * spaces.S).topRows(n);
  quotient.E_0 = -PAS * arithmetic.pseudo_inverse(CS, scale);
  quotient.A_0 = (quotient.P * A + quotient.E_0 * C) * quotient.P.transpose();
  quotient.margin = arithmetic.margin();
  return quotient;
}

GeometricFilter complete_filter(const GeometricQuotient& quotient,
                                const std::vector<std::complex<double>>& poles) {
  const PolePlacement placement = place_poles(quotient.A_0, quotient.M, poles);
  GeometricFilter filter;
  filter.is_possible = placement.is_possible;
  filter.reason = placement.reason;
  if (filter.is_possible) {
    filter.F = quotient.A_0 + placement.D_1 * quotient.M;
    filter.E = without_rounding_errors(quotient.E_0 + placement.D_1 * quotient.H);
  }
  return filter;
}

}  // namespace faultline

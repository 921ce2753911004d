#include "diagnosis/design/geometric.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include <Eigen/QR>

#include "diagnosis/design/balance.h"
#include "diagnosis/design/joined_matrices.h"
#include "diagnosis/design/pole_placement.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Entries below this fraction of the largest are rounding errors of exact zeros. With them in H and
// E a residual would seem to use channels that it does not use.
constexpr double kRoundingError = 1e-13;

// `size` of the terms that X is the difference of.
MatrixXd without_rounding_errors(const MatrixXd& X, double size) {
  return (X.array().abs() > kRoundingError * size).select(X, 0.0);
}

MatrixXd without_rounding_errors(const MatrixXd& X) {
  return without_rounding_errors(X, X.size() == 0 ? 0.0 : X.cwiseAbs().maxCoeff());
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
    const double unit = std::max(ignored.state.col(j).norm() / data_scale(A),
                                 ignored.output.col(j).norm() / data_scale(C));
    plant.A.col(next).head(n) = ignored.state.col(j) / unit;
    plant.C.col(next) = ignored.output.col(j) / unit;
    plant.L(next, j) = 1.0;
    ++next;
  }
  return plant;
}

// Projector, in the plant's own units, on the part of a subspace (in balanced units, behind the
// plant's states the added ones) that belongs to the plant's states.
MatrixXd own_projector(const MatrixXd& space, Index dimension, const VectorXd& state_units) {
  const Index n = state_units.size();
  const MatrixXd projector = (space * space.transpose()).topLeftCorner(n, n);
  if (dimension == 0 || (state_units.array() == 1.0).all()) {
    return projector;
  }
  const MatrixXd basis =
      state_units.asDiagonal() * canonical_rows(projector, dimension).transpose();
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(basis);
  const MatrixXd Q = qr.householderQ() * MatrixXd::Identity(n, dimension);
  return Q * Q.transpose();
}

// Rows of H: orthonormal basis of (C S)^⊥ within Im [C, D of all directions]: a sensor that only a
// disturbance reaches tells of it.
MatrixXd residual_outputs(const MatrixXd& C, const MatrixXd& direction_outputs, const MatrixXd& CS,
                          double scale, SubspaceArithmetic& arithmetic) {
  const MatrixXd reached =
      arithmetic.image(side_by_side(C / data_scale(C), unit_columns(direction_outputs)), 1.0);
  const MatrixXd blind = arithmetic.image(CS, scale);
  const MatrixXd basis = reached * arithmetic.kernel(blind.transpose() * reached, 1.0);
  return without_rounding_errors(canonical_rows(basis * basis.transpose(), basis.cols()));
}

}  // namespace

UnobservabilitySubspaces unobservability_subspaces(const MatrixXd& A, const MatrixXd& C,
                                                   const MatrixXd& L,
                                                   SubspaceArithmetic& arithmetic) {
  // The subspaces of A and of A - α I are the same, but a part common to all eigenvalues would
  // hide the others: a plant sampled often has A_d ≈ I.
  const Index n = A.rows();
  const double mean = n == 0 ? 0.0 : A.trace() / static_cast<double>(n);
  const MatrixXd A_shifted = without_rounding_errors(A - mean * MatrixXd::Identity(n, n), A.norm());
  const MatrixXd A_unit = A_shifted / data_scale(A_shifted);
  const MatrixXd C_unit = C / data_scale(C);
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

std::vector<double> visible_margins(const MatrixXd& P, const MatrixXd& E_0, const MatrixXd& H,
                                    const Directions& directions) {
  const auto& [state, output] = directions;
  std::vector<double> margins;
  for (Index j = 0; j < state.cols(); ++j) {
    const double size = std::hypot(state.col(j).norm(), output.col(j).norm());
    const VectorXd seen = P * state.col(j) + E_0 * output.col(j);
    const double distance = std::hypot(seen.norm(), (H * output.col(j)).norm());
    margins.push_back(size > 0.0 ? distance / size : 0.0);
  }
  return margins;
}

GeometricQuotient geometric_quotient(const MatrixXd& A, const MatrixXd& C,
                                     const Directions& ignored, const Directions& visible,
                                     double tolerance) {
  assert(ignored.state.rows() == A.rows() && ignored.output.rows() == C.rows());
  const Index n = A.rows();
  const Balance units = balance(
      A, C,
      {side_by_side(ignored.state, visible.state), side_by_side(ignored.output, visible.output)});
  const MatrixXd A_b = units.of_state(A);
  const MatrixXd C_b = units.of_output(C);
  const Directions ignored_b = units.of_directions(ignored);
  const Directions visible_b = units.of_directions(visible);
  const ExtendedPlant plant = extend(A_b, C_b, ignored_b);
  SubspaceArithmetic arithmetic(tolerance);
  const UnobservabilitySubspaces spaces =
      unobservability_subspaces(plant.A, plant.C, plant.L, arithmetic);

  GeometricQuotient quotient;
  quotient.units = units;
  quotient.dim_w = spaces.W.cols() - plant.added;
  quotient.dim_s = spaces.S.cols() - plant.added;
  // W* and S* contain the added states: on the plant's own states they project as themselves.
  const MatrixXd projector_s = (spaces.S * spaces.S.transpose()).topLeftCorner(n, n);
  quotient.projector_w = own_projector(spaces.W, quotient.dim_w, units.state);
  quotient.projector_s = own_projector(spaces.S, quotient.dim_s, units.state);
  const MatrixXd P_b = canonical_rows(MatrixXd::Identity(n, n) - projector_s, n - quotient.dim_s);
  quotient.P = P_b * units.state.cwiseInverse().asDiagonal();

  const MatrixXd CS = plant.C * spaces.S;
  const double scale = data_scale(plant.C);
  const MatrixXd H_b = residual_outputs(C_b, side_by_side(ignored_b.output, visible_b.output), CS,
                                        scale, arithmetic);
  quotient.H = H_b * units.output.cwiseInverse().asDiagonal();
  quotient.M = H_b * C_b * P_b.transpose();
  const MatrixXd PAS = P_b * (plant.A * spaces.S).topRows(n);
  const MatrixXd E_b = -PAS * arithmetic.pseudo_inverse(CS, scale);
  quotient.E_0 = E_b * units.output.cwiseInverse().asDiagonal();
  quotient.A_0 = (P_b * A_b + E_b * C_b) * P_b.transpose();
  quotient.margin = arithmetic.margin();
  quotient.visible_margin = visible_margins(P_b, E_b, H_b, visible_b);
  return quotient;
}

DimensionStability dimension_stability(const MatrixXd& A, const MatrixXd& C,
                                       const Directions& ignored, const Directions& visible,
                                       const GeometricQuotient& quotient) {
  const RankMargin& margin = quotient.margin;
  DimensionStability stability{kRankTolerance, kRankTolerance};
  const auto is_same = [&](double tolerance) {
    // Between the singular values kept and dropped every tolerance decides alike.
    if (margin.largest_dropped <= tolerance && tolerance < margin.smallest_kept) {
      return true;
    }
    const GeometricQuotient other = geometric_quotient(A, C, ignored, visible, tolerance);
    return other.dim_w == quotient.dim_w && other.dim_s == quotient.dim_s &&
           other.H.rows() == quotient.H.rows();
  };
  for (const double tolerance : {1e-10, 1e-11, 1e-12}) {
    if (!is_same(tolerance)) {
      break;
    }
    stability.tolerance_min = tolerance;
  }
  for (const double tolerance : {1e-8, 1e-7, 1e-6}) {
    if (!is_same(tolerance)) {
      break;
    }
    stability.tolerance_max = tolerance;
  }
  return stability;
}

GeometricFilter complete_filter(const GeometricQuotient& quotient, const PolePlacement& placement) {
  const VectorXd& units = quotient.units.output;
  const MatrixXd E = quotient.E_0 + placement.D_1 * quotient.H;
  return {quotient.A_0 + placement.D_1 * quotient.M,
          without_rounding_errors(E * units.asDiagonal()) * units.cwiseInverse().asDiagonal()};
}

}  // namespace faultline

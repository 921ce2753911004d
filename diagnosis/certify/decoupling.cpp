#include "diagnosis/certify/decoupling.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "diagnosis/certify/balance.h"
#include "diagnosis/certify/orthogonal.h"
#include "diagnosis/certify/sampled_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Tolerances over which dimensions should stand; the certificate's own is in their middle. Data are
// rarely good to 1e-6, and rounding errors stay below 1e-12.
constexpr std::array kTolerances = {1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6};
constexpr std::size_t kOwnTolerance = 3;
// Output units that differ by less than this are left alone.
constexpr double kSaneSpread = 16.0;

double norm_or_one(const MatrixXd& X) {
  const double norm = X.norm();
  return norm > 0.0 ? norm : 1.0;
}

MatrixXd joined(const MatrixXd& X, const MatrixXd& Y) {
  MatrixXd both(X.rows(), X.cols() + Y.cols());
  both << X, Y;
  return both;
}

MatrixXd unit_columns(MatrixXd X) {
  for (Index j = 0; j < X.cols(); ++j) {
    X.col(j) /= norm_or_one(X.col(j));
  }
  return X;
}

VectorXd output_scales(const MatrixXd& C) {
  VectorXd scales(C.rows());
  for (Index i = 0; i < C.rows(); ++i) {
    scales[i] = power_of_two(C.row(i).norm());
  }
  const bool is_sane = C.rows() == 0 || scales.maxCoeff() <= kSaneSpread * scales.minCoeff();
  return is_sane ? VectorXd::Ones(C.rows()) : scales;
}

}  // namespace

DecouplingAnalysis::DecouplingAnalysis(const PlantModel& plant, const Bank& bank) {
  const DomainModel model = domain_model(plant, bank);
  // Constant disturbances: more states behind x.
  const Index n = model.A.rows();
  const Index constant = model.constant_states.cols();
  const Index total = n + constant;
  A_ = MatrixXd::Zero(total, total);
  A_.topLeftCorner(n, n) = model.A;
  A_.topRightCorner(n, constant) = model.constant_states;
  if (model.is_sampled) {
    A_.bottomRightCorner(constant, constant).setIdentity();
  }
  C_ = joined(model.C, model.constant_outputs);
  const auto with_constants = [&](const MatrixXd& states) {
    MatrixXd extended = MatrixXd::Zero(total, states.cols());
    extended.topRows(n) = states;
    return extended;
  };
  fault_states_ = with_constants(model.fault_states);
  fault_outputs_ = model.fault_outputs;
  decoupled_states_ = with_constants(model.decoupled_states);
  decoupled_outputs_ = model.decoupled_outputs;
  state_scales_ = state_scales(A_, joined(fault_states_, decoupled_states_), C_);
  output_scales_ = output_scales(C_ * state_scales_.asDiagonal());
}

DecouplingAnalysis::ExtendedPlant DecouplingAnalysis::extend(const MatrixXd& A, const MatrixXd& C,
                                                             const MatrixXd& states,
                                                             const MatrixXd& outputs) {
  const Index n = A.rows();
  ExtendedPlant plant;
  for (Index j = 0; j < outputs.cols(); ++j) {
    plant.added += outputs.col(j).isZero(0.0) ? 0 : 1;
  }
  const Index total = n + plant.added;
  plant.A = MatrixXd::Zero(total, total);
  plant.A.topLeftCorner(n, n) = A;
  plant.C = MatrixXd::Zero(C.rows(), total);
  plant.C.leftCols(n) = C;
  plant.L = MatrixXd::Zero(total, states.cols());
  Index next = n;
  for (Index j = 0; j < states.cols(); ++j) {
    if (outputs.col(j).isZero(0.0)) {
      plant.L.col(j).head(n) = states.col(j);
      continue;
    }
    // In this unit of m_j neither of its columns is larger than A, or C.
    const double unit =
        std::max(states.col(j).norm() / norm_or_one(A), outputs.col(j).norm() / norm_or_one(C));
    plant.A.col(next).head(n) = states.col(j) / unit;
    plant.C.col(next) = outputs.col(j) / unit;
    plant.L(next, j) = 1.0;
    ++next;
  }
  return plant;
}

DecouplingAnalysis::Subspaces DecouplingAnalysis::subspaces(const ExtendedPlant& plant,
                                                            double tolerance) {
  OrthogonalArithmetic arithmetic(tolerance);
  const Index n = plant.A.rows();
  const MatrixXd A_t = plant.A.transpose() / norm_or_one(plant.A);
  const MatrixXd C_t = arithmetic.split(plant.C.transpose(), norm_or_one(plant.C)).inside;

  // V*: shrinks until it stands.
  MatrixXd V = arithmetic.split(unit_columns(plant.L), 1.0).outside;
  for (;;) {
    const MatrixXd beyond = C_t - V * (V.transpose() * C_t);
    const MatrixXd beside = arithmetic.split(beyond, 1.0).inside;
    const MatrixXd left_over = complement_of(joined(V, beside));
    const MatrixXd stays = arithmetic.kernel(left_over.transpose() * A_t * V, 1.0);
    if (stays.cols() == V.cols()) {
      break;
    }
    V = (V * stays).eval();
  }
  // R*: grows until it stands. On data whose ranks flip with rounding it might not: a step that
  // does not grow ends it.
  MatrixXd R(n, 0);
  for (;;) {
    const MatrixXd left_over = arithmetic.split(joined(C_t, A_t * R), 1.0).outside;
    MatrixXd next = V * arithmetic.kernel(left_over.transpose() * V, 1.0);
    if (next.cols() <= R.cols()) {
      break;
    }
    R = std::move(next);
  }
  Subspaces found;
  found.dim_w = n - V.cols() - plant.added;
  found.dim_s = n - R.cols() - plant.added;
  found.S = complement_of(R);
  found.S_complement = std::move(R);
  found.smallest_kept = arithmetic.smallest_kept();
  found.largest_dropped = arithmetic.largest_dropped();
  return found;
}

RankCertificate DecouplingAnalysis::rank_certificate(const ExtendedPlant& plant,
                                                     const Subspaces& found) {
  const auto is_same = [&](double tolerance) {
    // Every decision falls alike for all tolerances between what was dropped and what was kept.
    if (tolerance > found.largest_dropped && tolerance < found.smallest_kept) {
      return true;
    }
    const Subspaces other = subspaces(plant, tolerance);
    return other.dim_w == found.dim_w && other.dim_s == found.dim_s;
  };
  std::size_t first = kOwnTolerance;
  std::size_t last = kOwnTolerance;
  while (first > 0 && is_same(kTolerances[first - 1])) {
    --first;
  }
  while (last + 1 < kTolerances.size() && is_same(kTolerances[last + 1])) {
    ++last;
  }
  return {static_cast<std::uint32_t>(found.dim_w), static_cast<std::uint32_t>(found.dim_s),
          // Without any decision there is nothing that could flip.
          std::isfinite(found.smallest_kept) ? found.smallest_kept : 1.0, found.largest_dropped,
          kTolerances[first], kTolerances[last]};
}

std::vector<double> DecouplingAnalysis::distances(const ExtendedPlant& plant, const MatrixXd& S,
                                                  const MatrixXd& P, const MatrixXd& states,
                                                  const MatrixXd& outputs) {
  // What of the outputs moves along S* moves: C s = Π D with the shortest s takes A s with it.
  OrthogonalArithmetic arithmetic(kTolerances[kOwnTolerance]);
  const MatrixXd s = S * arithmetic.shortest_solution(plant.C * S, norm_or_one(plant.C), outputs);
  const Index n = states.rows();
  const MatrixXd state = P.topRows(n).transpose() * (states - (plant.A * s).topRows(n));
  const MatrixXd output = outputs - plant.C * s;
  std::vector<double> distances;
  for (Index j = 0; j < states.cols(); ++j) {
    const double size = std::hypot(states.col(j).norm(), outputs.col(j).norm());
    distances.push_back(size > 0.0 ? std::hypot(state.col(j).norm(), output.col(j).norm()) / size
                                   : 0.0);
  }
  return distances;
}

std::vector<double> DecouplingAnalysis::margins(const ExtendedPlant& plain,
                                                const ExtendedPlant& balanced,
                                                const Subspaces& found) const {
  const Index n = A_.rows();
  // Of the added states: their units in the two coordinates, from the columns they stand for.
  VectorXd scales(n + plain.added);
  scales.head(n) = state_scales_;
  for (Index i = n; i < scales.size(); ++i) {
    const VectorXd own_output = plain.C.col(i);
    const VectorXd balanced_output = output_scales_.asDiagonal() * balanced.C.col(i);
    scales[i] = balanced_output.norm() / own_output.norm();
  }
  std::vector<double> margins =
      distances(plain, orthonormal_basis(scales.asDiagonal() * found.S),
                orthonormal_basis(scales.cwiseInverse().asDiagonal() * found.S_complement),
                fault_states_, fault_outputs_);
  if (state_scales_.isOnes(0.0) && output_scales_.isOnes(0.0)) {
    return margins;
  }
  // What is inside in balanced coordinates is inside in all. In badly scaled ones rounding errors
  // would hide that.
  const std::vector<double> in_balance =
      distances(balanced, found.S, found.S_complement,
                state_scales_.cwiseInverse().asDiagonal() * fault_states_,
                output_scales_.cwiseInverse().asDiagonal() * fault_outputs_);
  for (std::size_t j = 0; j < margins.size(); ++j) {
    if (in_balance[j] <= kTolerances[kOwnTolerance]) {
      margins[j] = std::min(margins[j], in_balance[j]);
    }
  }
  return margins;
}

Decoupling DecouplingAnalysis::of(const std::vector<std::size_t>& ignores) const {
  const auto count = std::ssize(ignores);
  MatrixXd states(A_.rows(), count + decoupled_states_.cols());
  MatrixXd outputs(C_.rows(), count + decoupled_outputs_.cols());
  Index i = 0;
  for (const std::size_t j : ignores) {
    states.col(i) = fault_states_.col(static_cast<Index>(j));
    outputs.col(i++) = fault_outputs_.col(static_cast<Index>(j));
  }
  states.rightCols(decoupled_states_.cols()) = decoupled_states_;
  outputs.rightCols(decoupled_outputs_.cols()) = decoupled_outputs_;

  const VectorXd to_balanced = state_scales_.cwiseInverse();
  const VectorXd to_unit = output_scales_.cwiseInverse();
  const ExtendedPlant plain = extend(A_, C_, states, outputs);
  const ExtendedPlant balanced =
      extend(to_balanced.asDiagonal() * A_ * state_scales_.asDiagonal(),
             to_unit.asDiagonal() * C_ * state_scales_.asDiagonal(),
             to_balanced.asDiagonal() * states, to_unit.asDiagonal() * outputs);
  const Subspaces found = subspaces(balanced, kTolerances[kOwnTolerance]);
  return {rank_certificate(balanced, found), margins(plain, balanced, found)};
}

}  // namespace faultline

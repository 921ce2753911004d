#include "diagnosis/design/uio/observer_filter.h"

#include <cmath>
#include <utility>

#include <Eigen/LU>

#include "diagnosis/design/subspace.h"
#include "diagnosis/design/with_rows.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

ObserverCertificate claims_of(const DesignedObserver& observer) {
  const ObserverSynthesis& synthesis = observer.synthesis;
  ObserverCertificate claims;
  claims.fault_states = observer.task.carry;
  claims.drift_bound =
      VectorXd::Constant(std::ssize(observer.task.carry), observer.task.drift_bound);
  claims.T = observer.decoupling.T;
  claims.gain = synthesis.gain;
  claims.alpha = synthesis.alpha;
  claims.P = synthesis.P;
  claims.mu_now = synthesis.mu_now;
  claims.mu_next = synthesis.mu_next;
  claims.mu_direct = synthesis.mu_direct;
  claims.beta = synthesis.beta;
  if (synthesis.beta > 0.0) {
    claims.detects = observer.task.detect;
    claims.band_low_rad = observer.band.low_rad;
    claims.band_high_rad = observer.band.high_rad;
  }
  return claims;
}

void add_nonlinearities(const PlantModel& plant, const ObserverPlant& sampled,
                        const DesignedObserver& observer, ResidualFilter& filter) {
  const ObserverModel& model = observer.model;
  for (Index i = 0; i < std::ssize(plant.nonlinearities); ++i) {
    const Nonlinearity& item = plant.nonlinearities[static_cast<std::size_t>(i)];
    FilterNonlinearity term;
    term.function = item.function;
    term.center = 0.5 * (item.slope_min + item.slope_max);
    term.radius = 0.5 * (item.slope_max - item.slope_min);
    term.W = item.gain * observer.decoupling.S * model.E_o.col(i);
    term.a_v = model.E_i.row(i).transpose();
    term.a_y = observer.decoupling.T.transpose() * term.a_v;
    term.a_u = -sampled.D.transpose() * term.a_y;
    filter.nonlinearities.push_back(std::move(term));
  }
}

// All that is the same for every residual of an observer.
ResidualFilter filter_without_residual(const PlantModel& plant, const ObserverPlant& sampled,
                                       const DesignedObserver& observer) {
  const DecouplingMatrices& decoupling = observer.decoupling;
  const MatrixXd& gain = observer.synthesis.gain;
  const Index total = observer.model.n();
  ResidualFilter filter;
  filter.F = decoupling.S * observer.model.A - gain * observer.model.C;
  filter.E = -(gain + filter.F * decoupling.T);
  filter.G = decoupling.S * with_rows(sampled.B, total) + filter.E * sampled.D;
  filter.L =
      decoupling.S * with_rows(sampled.fault_states, total) + filter.E * sampled.fault_outputs;
  add_nonlinearities(plant, sampled, observer, filter);
  filter.observer = claims_of(observer);
  filter.evaluation = Evaluation::kComponent;
  return filter;
}

// Seen at rest, only in transients, or not at all: the rest gain with the slopes in the middle,
// relative to what its paths could add up to.
void find_sensitivities(const ObserverPlant& sampled, const DesignedObserver& observer,
                        ResidualFilter& filter) {
  const MatrixXd gains = rest_gains(filter, sampled, observer, -1);
  const Index d = filter.F.rows();
  const MatrixXd response =
      filter.M * (MatrixXd::Identity(d, d) - filter.F).partialPivLu().inverse();
  filter.sees.resize(static_cast<std::size_t>(gains.cols()));
  for (Index j = 0; j < gains.cols(); ++j) {
    const double paths = response.norm() * filter.L.col(j).norm() + filter.J.col(j).norm();
    // The first samples of a step: a residual that stays silent in all of them never sees it.
    double transient = filter.J.col(j).norm();
    MatrixXd power = filter.M;
    for (Index i = 0; i < d; ++i) {
      transient = std::max(transient, (power * filter.L.col(j)).norm());
      power = (power * filter.F).eval();
    }
    const double zero = kRankTolerance * paths;
    filter.sees[static_cast<std::size_t>(j)] = gains.col(j).norm() > zero ? Sensitivity::kSteady
                                               : transient > zero         ? Sensitivity::kTransient
                                                                          : Sensitivity::kNone;
    if (filter.sees[static_cast<std::size_t>(j)] == Sensitivity::kNone) {
      filter.ignores.push_back(static_cast<std::size_t>(j));
    }
  }
}

}  // namespace

ResidualFilter output_filter(const PlantModel& plant, const ObserverPlant& sampled,
                             const DesignedObserver& observer, std::string name) {
  ResidualFilter filter = filter_without_residual(plant, sampled, observer);
  const Index q = plant.q();
  filter.name = std::move(name);
  filter.M = -observer.model.C;
  filter.H = observer.model.C * observer.decoupling.T - MatrixXd::Identity(q, q);
  filter.K = filter.H * sampled.D;
  filter.J = filter.H * sampled.fault_outputs;
  filter.course = ThresholdCourse{.weight = observer.synthesis.weight};
  find_sensitivities(sampled, observer, filter);
  return filter;
}

ResidualFilter size_filter(const PlantModel& plant, const ObserverPlant& sampled,
                           const DesignedObserver& observer, std::size_t carried,
                           std::string name) {
  ResidualFilter filter = filter_without_residual(plant, sampled, observer);
  filter.name = std::move(name);
  filter.M = MatrixXd::Zero(1, observer.model.n());
  filter.M(0, plant.n() + static_cast<Index>(carried)) = 1.0;
  filter.H = -filter.M * observer.decoupling.T;
  filter.K = filter.H * sampled.D;
  filter.J = filter.H * sampled.fault_outputs;
  filter.course = ThresholdCourse{.weight = MatrixXd::Identity(1, 1)};
  filter.estimation = FaultEstimation{.fault = observer.task.carry[carried]};
  find_sensitivities(sampled, observer, filter);
  return filter;
}

MatrixXd rest_gains(const ResidualFilter& filter, const ObserverPlant& sampled,
                    const DesignedObserver& observer, Index vertex) {
  const Index d = filter.F.rows();
  MatrixXd F = filter.F;
  MatrixXd L = filter.L;
  if (vertex >= 0) {
    const MatrixXd S_Lambda = observer.decoupling.S * observer.model.vertex(vertex);
    F += S_Lambda;
    L -= S_Lambda * observer.decoupling.T * sampled.fault_outputs;
  }
  return -(filter.M * (MatrixXd::Identity(d, d) - F).partialPivLu().solve(L) + filter.J);
}

}  // namespace faultline

#include "tests/diagnosis/certify/observer_simulation.h"

#include "diagnosis/certify/observer_loop.h"
#include "diagnosis/model/discretize.h"

namespace faultline {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

double sign(double value) { return value < 0.0 ? -1.0 : 1.0; }

double middle(const Nonlinearity& term) { return 0.5 * (term.slope_min + term.slope_max); }

double half_range(const Nonlinearity& term) { return 0.5 * (term.slope_max - term.slope_min); }

}  // namespace

ObserverSimulation::ObserverSimulation(const PlantModel& plant, const Bank& bank,
                                       const ResidualFilter& filter)
    : plant_(plant), bank_(bank), filter_(filter) {
  const Index k = std::ssize(plant.faults), s = std::ssize(plant.disturbances);
  MatrixXd columns(plant.n(), k + s + std::ssize(plant.nonlinearities));
  Index at = 0;
  for (const Fault& fault : plant.faults) columns.col(at++) = fault.state;
  for (const Disturbance& disturbance : plant.disturbances) columns.col(at++) = disturbance.state;
  for (const Nonlinearity& term : plant.nonlinearities) columns.col(at++) = term.gain * term.E_o;
  const double T = bank.sample_time_s;
  const SampledSystem system =
      bank.domain == DesignDomain::kEuler
          ? SampledSystem{MatrixXd::Identity(plant.n(), plant.n()) + T * plant.A, T * columns}
          : discretize_zoh(plant.A, columns, T);
  A_ = system.A;
  B_f_ = system.B.leftCols(k);
  B_d_ = system.B.middleCols(k, s);
  E_o_ = system.B.rightCols(columns.cols() - k - s);
  start(VectorXd::Zero(plant.n()));
}

void ObserverSimulation::start(const VectorXd& x) {
  x_ = x;
  v_ = VectorXd::Zero(filter_.F.rows());
}

VectorXd ObserverSimulation::step(const Sample& sample, const VectorXd& y_error) {
  VectorXd y = plant_.C * x_;
  Index at = 0;
  for (const Disturbance& item : plant_.disturbances) y += sample.unknown[at++] * item.output;
  for (const Noise& noise : plant_.noises) y += sample.unknown[at++] * noise.output;
  for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
    y += sample.fault[static_cast<Index>(j)] * plant_.faults[j].output;
  }
  if (y_error.size() > 0) y += y_error;
  const VectorXd r = filter_.M * v_ - filter_.H * y;
  VectorXd v = filter_.F * v_ - filter_.E * y;
  VectorXd x = A_ * x_ + B_f_ * sample.fault + B_d_ * sample.unknown.head(B_d_.cols());
  for (std::size_t i = 0; i < filter_.nonlinearities.size(); ++i) {
    const FilterNonlinearity& term = filter_.nonlinearities[i];
    const double slope = sample.slope[static_cast<Index>(i)];
    v += (slope - term.center) * (term.a_v.dot(v_) + term.a_y.dot(y)) * term.W;
    x += slope * plant_.nonlinearities[i].E_i.dot(x_) * E_o_.col(static_cast<Index>(i));
  }
  v_ = v;
  x_ = x;
  return r;
}

ObserverSimulation::Sample ObserverSimulation::random_sample(std::mt19937_64& engine) const {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto random = [&] {
    const double value = uniform(engine);
    return uniform(engine) < 0.0 ? sign(value) : value;
  };
  Sample sample;
  sample.unknown = VectorXd(std::ssize(plant_.disturbances) + std::ssize(plant_.noises));
  Index at = 0;
  for (std::size_t i = 0; i < plant_.disturbances.size(); ++i) {
    const bool is_decoupled =
        bank_.disturbances[i].treatment == BankDisturbance::Treatment::kDecoupled;
    sample.unknown[at++] = (is_decoupled ? 1.0 : *plant_.disturbances[i].bound) * random();
  }
  for (const Noise& noise : plant_.noises) sample.unknown[at++] = *noise.bound * random();
  sample.fault = VectorXd::Zero(std::ssize(plant_.faults));
  sample.slope = VectorXd(std::ssize(plant_.nonlinearities));
  for (std::size_t i = 0; i < plant_.nonlinearities.size(); ++i) {
    const Nonlinearity& term = plant_.nonlinearities[i];
    sample.slope[static_cast<Index>(i)] = middle(term) + half_range(term) * random();
  }
  return sample;
}

VectorXd ObserverSimulation::random_state(std::mt19937_64& engine) const {
  std::bernoulli_distribution coin;
  VectorXd x = *plant_.state_range;
  for (double& value : x) value *= coin(engine) ? 1.0 : -1.0;
  return x;
}

WorstCourse worst_course(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter,
                         Index row, std::size_t samples) {
  const ObserverLoop loop = observer_loop(plant, bank, filter);
  const Index unknown = std::ssize(plant.disturbances) + std::ssize(plant.noises);
  const std::size_t last = samples - 1;
  std::vector<VectorXd> delta(samples, loop.radius);
  std::vector<VectorXd> w(samples), p(samples), e(samples);
  VectorXd x;
  const auto N_at = [&](std::size_t k) {
    return MatrixXd(loop.N + loop.S_E * delta[k].asDiagonal() * loop.E_i);
  };
  constexpr int kTurns = 6;
  for (int turn = 0; turn < kTurns; ++turn) {
    // Backwards: what e_k and w_k add to the row in the end.
    p[last] = loop.R.row(row).transpose();
    for (std::size_t k = last; k-- > 0;) p[k] = N_at(k).transpose() * p[k + 1];
    for (std::size_t k = 0; k < samples; ++k) {
      VectorXd weight = loop.B_next.transpose() * p[k];
      if (k < last) weight += loop.B_now.transpose() * p[k + 1];
      if (k == last) weight += loop.Q.row(row).transpose();
      w[k] = loop.w_bound.cwiseProduct(weight.unaryExpr(&sign));
    }
    x = plant.state_range->cwiseProduct(
        (loop.S.transpose() * p[0]).head(plant.n()).unaryExpr(&sign));
    // Forwards: the slopes that help.
    e[0] = loop.S.leftCols(plant.n()) * x + loop.B_next * w[0];
    for (std::size_t k = 0; k < last; ++k) {
      const VectorXd push = loop.S_E.transpose() * p[k + 1];
      delta[k] = loop.radius.cwiseProduct(push.cwiseProduct(loop.E_i * e[k]).unaryExpr(&sign));
      e[k + 1] = N_at(k) * e[k] + loop.B_now * w[k] + loop.B_next * w[k + 1];
    }
  }
  WorstCourse course{x, {}};
  for (std::size_t k = 0; k < samples; ++k) {
    ObserverSimulation::Sample sample{w[k].head(unknown), VectorXd::Zero(std::ssize(plant.faults)),
                                      VectorXd(loop.terms())};
    for (Index i = 0; i < loop.terms(); ++i) {
      const Nonlinearity& term = plant.nonlinearities[static_cast<std::size_t>(i)];
      sample.slope[i] = middle(term) + delta[k][i] / term.gain;
    }
    course.samples.push_back(std::move(sample));
  }
  return course;
}

}  // namespace faultline

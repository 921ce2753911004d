#include "diagnosis/certify/observer_loop.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/certify/balance.h"
#include "diagnosis/certify/plant_step.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Treatment = BankDisturbance::Treatment;

// Every corner of the slopes is looked at: 256 of them.
constexpr Index kMostTerms = 8;
// Columns below this part of their terms are rounding errors.
constexpr double kRoundingError = 1e-12;
// A decoupled disturbance may be left of which this part: T comes from a solution of equations, and
// is as good as their condition.
constexpr double kDecoupled = 1e-9;

class LoopBuilder {
 public:
  LoopBuilder(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter)
      : plant_(plant), bank_(bank), filter_(filter), claims_(*filter.observer) {}

  ObserverLoop build() {
    check_claims();
    sample();
    add_carried_faults();
    loop_.T = claims_.T;
    loop_.gain = claims_.gain;
    const Index n = loop_.A.rows();
    loop_.S = MatrixXd::Identity(n, n) - loop_.T * loop_.C;
    loop_.N = loop_.S * loop_.A - loop_.gain * loop_.C;
    loop_.S_E = loop_.S * E_o_;
    choose_output();
    add_faults();
    add_unknown_inputs();
    bound_start();
    return loop_;
  }

 private:
  [[noreturn]] static void refuse(const std::string& why) { throw std::invalid_argument(why); }

  void check_claims() const {
    if (bank_.method != "uio") {
      refuse(fmt::format("found an observer in a bank of method \"{}\", expected \"uio\"",
                         bank_.method));
    }
    if (!is_sampled(bank_.domain) && plant_.time == TimeDomain::kContinuous) {
      refuse(
          "found an observer in the continuous domain, expected \"sampled\" or \"euler\": "
          "its bounds are those of difference equations");
    }
    if (std::ssize(plant_.nonlinearities) > kMostTerms) {
      refuse(
          fmt::format("found {} nonlinearities in plant \"{}\", expected at most {}: every corner "
                      "of their slopes is looked at",
                      plant_.nonlinearities.size(), plant_.name, kMostTerms));
    }
    std::vector<std::size_t> carried = claims_.fault_states;
    std::sort(carried.begin(), carried.end());
    if (std::adjacent_find(carried.begin(), carried.end()) != carried.end() ||
        (!carried.empty() && carried.back() >= plant_.faults.size())) {
      refuse(
          fmt::format("found faults carried as states that are not in the plant, or twice; "
                      "expected different ones below {}",
                      plant_.faults.size()));
    }
    const Index n = plant_.n() + std::ssize(carried);
    for (const auto& [name, matrix] :
         {std::pair("T", &claims_.T), std::pair("gain", &claims_.gain)}) {
      if (matrix->rows() != n || matrix->cols() != plant_.q() || !matrix->allFinite()) {
        refuse(fmt::format("found {}x{} numbers as {}, expected {}x{} finite ones", matrix->rows(),
                           matrix->cols(), name, n, plant_.q()));
      }
    }
    if (claims_.drift_bound.size() != std::ssize(carried) ||
        (claims_.drift_bound.size() > 0 && !(claims_.drift_bound.minCoeff() > 0.0)) ||
        !claims_.drift_bound.allFinite()) {
      refuse(
          fmt::format("found {} bounds of drifts, expected one positive number for each of the {} "
                      "faults carried as states",
                      claims_.drift_bound.size(), carried.size()));
    }
    if (filter_.estimation &&
        std::find(carried.begin(), carried.end(), filter_.estimation->fault) == carried.end()) {
      refuse(fmt::format("found an estimate of fault {}, expected one that the observer carries",
                         filter_.estimation->fault));
    }
  }

  // All columns of the state equation at once: inputs, faults, disturbances, Lipschitz terms.
  void sample() {
    const Index m = plant_.m(), k = std::ssize(plant_.faults), s = std::ssize(plant_.disturbances);
    const Index l = std::ssize(plant_.nonlinearities);
    MatrixXd columns(plant_.n(), m + k + s + l);
    columns.leftCols(m) = plant_.B;
    F_y_ = MatrixXd(plant_.q(), k);
    disturbance_outputs_ = MatrixXd(plant_.q(), s);
    for (Index j = 0; j < k; ++j) {
      const Fault& fault = plant_.faults[static_cast<std::size_t>(j)];
      columns.col(m + j) = fault.state;
      F_y_.col(j) = fault.output;
    }
    for (Index i = 0; i < s; ++i) {
      const Disturbance& disturbance = plant_.disturbances[static_cast<std::size_t>(i)];
      columns.col(m + k + i) = disturbance.state;
      disturbance_outputs_.col(i) = disturbance.output;
    }
    loop_.E_i = MatrixXd(l, plant_.n());
    loop_.radius = VectorXd(l);
    for (Index i = 0; i < l; ++i) {
      const Nonlinearity& term = plant_.nonlinearities[static_cast<std::size_t>(i)];
      columns.col(m + k + s + i) = term.E_o;
      loop_.E_i.row(i) = term.E_i.transpose();
      loop_.radius[i] = std::abs(term.gain) * 0.5 * (term.slope_max - term.slope_min);
    }
    const VectorXd scales = state_scales(plant_.A, columns, plant_.C);
    const SampledSystem system = plant_step(plant_, bank_, columns, scales);
    columns = scales.asDiagonal() * system.B;
    loop_.A = scales.asDiagonal() * system.A * scales.cwiseInverse().asDiagonal();
    loop_.B = columns.leftCols(m);
    loop_.C = plant_.C;
    loop_.D = plant_.D;
    F_x_ = columns.middleCols(m, k);
    disturbance_states_ = columns.middleCols(m + k, s);
    E_o_ = columns.rightCols(l);
  }

  // m_k+1 = m_k + drift behind the plant's states.
  void add_carried_faults() {
    const Index n = plant_.n();
    const Index carried = std::ssize(claims_.fault_states);
    const auto with_zeros = [&](const MatrixXd& X) {
      MatrixXd more = MatrixXd::Zero(n + carried, X.cols());
      more.topRows(n) = X;
      return more;
    };
    MatrixXd A = MatrixXd::Identity(n + carried, n + carried);
    A.topLeftCorner(n, n) = loop_.A;
    MatrixXd C = MatrixXd::Zero(plant_.q(), n + carried);
    C.leftCols(n) = loop_.C;
    MatrixXd E_i = MatrixXd::Zero(loop_.E_i.rows(), n + carried);
    E_i.leftCols(n) = loop_.E_i;
    for (Index j = 0; j < carried; ++j) {
      const auto fault = static_cast<Index>(claims_.fault_states[static_cast<std::size_t>(j)]);
      A.col(n + j).head(n) = F_x_.col(fault);
      C.col(n + j) = F_y_.col(fault);
    }
    loop_.A = A;
    loop_.C = C;
    loop_.E_i = E_i;
    loop_.B = with_zeros(loop_.B);
    F_x_ = with_zeros(F_x_);
    disturbance_states_ = with_zeros(disturbance_states_);
    E_o_ = with_zeros(E_o_);
  }

  void choose_output() {
    loop_.is_estimate = filter_.estimation.has_value();
    loop_.R = loop_.C;
    if (!loop_.is_estimate) return;
    const auto place = std::find(claims_.fault_states.begin(), claims_.fault_states.end(),
                                 filter_.estimation->fault);
    loop_.R = MatrixXd::Zero(1, loop_.n());
    loop_.R(0, plant_.n() + std::distance(claims_.fault_states.begin(), place)) = -1.0;
  }

  void add_faults() {
    loop_.F_now = loop_.S * F_x_ - loop_.gain * F_y_;
    loop_.F_next = -loop_.T * F_y_;
    loop_.J = F_y_;
    if (loop_.is_estimate) loop_.J = MatrixXd::Zero(1, F_y_.cols());
  }

  void add_unknown_inputs() {
    const Index s = std::ssize(plant_.disturbances);
    const Index noises = std::ssize(plant_.noises);
    const Index carried = std::ssize(claims_.fault_states);
    MatrixXd M = MatrixXd::Zero(loop_.n(), s + noises + carried);
    MatrixXd W = MatrixXd::Zero(plant_.q(), M.cols());
    M.leftCols(s) = disturbance_states_;
    M.bottomRightCorner(carried, carried).setIdentity();
    W.leftCols(s) = disturbance_outputs_;
    loop_.w_bound = VectorXd::Zero(M.cols());
    for (Index i = 0; i < noises; ++i) {
      const Noise& noise = plant_.noises[static_cast<std::size_t>(i)];
      if (!noise.bound) {
        refuse(
            fmt::format("found [[noise]] {} of plant \"{}\" without a bound, expected one: "
                        "thresholds are proved for noise within its bound",
                        i + 1, plant_.name));
      }
      W.col(s + i) = noise.output;
      loop_.w_bound[s + i] = *noise.bound;
    }
    const MatrixXd B_now = loop_.S * M - loop_.gain * W;
    loop_.B_now = B_now;
    loop_.B_next = -loop_.T * W;
    loop_.Q = loop_.is_estimate ? MatrixXd(MatrixXd::Zero(1, W.cols())) : W;
    for (Index i = 0; i < W.cols(); ++i) {
      const double now = loop_.S.norm() * M.col(i).norm() + loop_.gain.norm() * W.col(i).norm();
      const double next = loop_.T.norm() * W.col(i).norm();
      const bool is_decoupled =
          i < s &&
          bank_.disturbances[static_cast<std::size_t>(i)].treatment == Treatment::kDecoupled;
      if (is_decoupled) check_decoupled(i, now, next);
      const double rounding = is_decoupled ? kDecoupled : kRoundingError;
      if (loop_.B_now.col(i).norm() <= rounding * now) loop_.B_now.col(i).setZero();
      if (loop_.B_next.col(i).norm() <= rounding * next) loop_.B_next.col(i).setZero();
      if (i < s && !is_decoupled) loop_.w_bound[i] = disturbance_bound(i);
    }
  }

  void check_decoupled(Index i, double now, double next) const {
    const double left =
        std::max({loop_.B_now.col(i).norm() - kDecoupled * now,
                  loop_.B_next.col(i).norm() - kDecoupled * next, loop_.Q.col(i).norm()});
    if (left > 0.0) {
      refuse(
          fmt::format("found disturbance {} decoupled, but {:.3g} of it reaches the error of the "
                      "observer",
                      plant_.disturbances[static_cast<std::size_t>(i)].name, left));
    }
  }

  [[nodiscard]] double disturbance_bound(Index i) const {
    const Disturbance& disturbance = plant_.disturbances[static_cast<std::size_t>(i)];
    if (!disturbance.bound) {
      refuse(
          fmt::format("found disturbance {} of plant \"{}\" without a bound, expected one: it is "
                      "not decoupled, and thresholds are proved for disturbances within their "
                      "bounds",
                      disturbance.name, plant_.name));
    }
    return *disturbance.bound;
  }

  void bound_start() {
    if (!plant_.state_range) {
      refuse(
          fmt::format("found plant \"{}\" without `range` of its states, expected the largest "
                      "deviation of each: thresholds from the first sample on begin with it",
                      plant_.name));
    }
    VectorXd x_bound = VectorXd::Zero(loop_.n());
    x_bound.head(plant_.n()) = *plant_.state_range;
    loop_.e_bound = loop_.S.cwiseAbs() * x_bound;
    loop_.e_bound += loop_.B_next.cwiseAbs() * loop_.w_bound;
  }

  const PlantModel& plant_;
  const Bank& bank_;
  const ResidualFilter& filter_;
  const ObserverCertificate& claims_;
  ObserverLoop loop_;
  MatrixXd F_x_, F_y_, disturbance_states_, disturbance_outputs_, E_o_;
};

}  // namespace

MatrixXd ObserverLoop::at_vertex(Index vertex) const {
  VectorXd delta = radius;
  for (Index i = 0; i < delta.size(); ++i) {
    if ((vertex & (Index{1} << i)) == 0) delta[i] = -delta[i];
  }
  return N + S_E * delta.asDiagonal() * E_i;
}

ObserverLoop observer_loop(const PlantModel& plant, const Bank& bank,
                           const ResidualFilter& filter) {
  return LoopBuilder(plant, bank, filter).build();
}

ObserverForm observer_form(const PlantModel& plant, const ObserverLoop& loop) {
  ObserverForm form;
  form.F = loop.N;
  form.E = -(loop.gain + loop.N * loop.T);
  form.G = loop.S * loop.B + form.E * loop.D;
  // r = R_v v + R_y ỹ.
  const Index q = loop.C.rows();
  const MatrixXd R_v = -loop.R;
  MatrixXd R_y = MatrixXd::Identity(q, q) - loop.C * loop.T;
  if (loop.is_estimate) R_y = R_v * loop.T;
  form.M = R_v;
  form.H = -R_y;
  form.K = -R_y * loop.D;
  for (Index i = 0; i < loop.terms(); ++i) {
    const Nonlinearity& plants = plant.nonlinearities[static_cast<std::size_t>(i)];
    FilterNonlinearity term;
    term.function = plants.function;
    term.center = 0.5 * (plants.slope_min + plants.slope_max);
    term.radius = 0.5 * (plants.slope_max - plants.slope_min);
    term.W = plants.gain * loop.S_E.col(i);
    term.a_v = loop.E_i.row(i).transpose();
    term.a_y = loop.T.transpose() * term.a_v;
    term.a_u = -loop.D.transpose() * term.a_y;
    form.nonlinearities.push_back(std::move(term));
  }
  return form;
}

}  // namespace faultline

#include "tests/diagnosis/certify/certify_cases.h"

#include <cmath>

#include <fmt/format.h>

#include "diagnosis/certify/certify.h"
#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/discretize.h"

namespace faultline {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

std::vector<std::string> numbered(char letter, Index count) {
  std::vector<std::string> names;
  for (Index i = 1; i <= count; ++i) {
    names.push_back(fmt::format("{}{}", letter, i));
  }
  return names;
}

}  // namespace

Bank CertifyCase::designed() const { return design_bank(plant, request).bank; }

Bank CertifyCase::certified() const {
  Bank bank = designed();
  certify(plant, bank);
  return bank;
}

PlantModel plant_of(const MatrixXd& A, const MatrixXd& B, const MatrixXd& C) {
  PlantModel plant;
  plant.name = "plant";
  plant.state_names = numbered('x', A.rows());
  plant.input_names = numbered('u', B.cols());
  plant.output_names = numbered('y', C.rows());
  plant.A = A;
  plant.B = B;
  plant.C = C;
  plant.D = MatrixXd::Zero(C.rows(), B.cols());
  plant.input_range = VectorXd::Constant(B.cols(), 100.0);
  plant.output_range = VectorXd::Constant(C.rows(), 100.0);
  plant.x_operating = VectorXd::Zero(A.rows());
  plant.u_operating = VectorXd::Zero(B.cols());
  plant.y_operating = VectorXd::Zero(C.rows());
  for (Index j = 0; j < B.cols(); ++j) {
    plant.faults.push_back({plant.input_names[static_cast<std::size_t>(j)], FaultKind::kActuator,
                            B.col(j), VectorXd::Zero(C.rows())});
  }
  return plant;
}

CertifyCase random_case(std::uint64_t seed, Index n, Index m, Index q, std::size_t concurrent,
                        DesignDomain domain) {
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> normal;
  const auto random = [&](Index rows, Index cols) {
    return MatrixXd(MatrixXd::NullaryExpr(rows, cols, [&] { return normal(engine); }));
  };
  const MatrixXd A =
      random(n, n) / std::sqrt(static_cast<double>(n)) - 1.5 * MatrixXd::Identity(n, n);
  const MatrixXd B = random(n, m);
  CertifyCase result;
  result.plant = plant_of(A, B, random(q, n));
  BankRequest& request = result.request;
  request.name = "random";
  request.concurrent = concurrent;
  request.sample_time_s = 0.01;
  request.threshold = 0.5;
  request.domain = domain;
  for (Index i = 0; i < n; ++i) {
    const double pole = -3.0 - 0.3 * static_cast<double>(i);
    request.poles.emplace_back(domain == DesignDomain::kSampled ? std::exp(0.01 * pole) : pole);
  }
  return result;
}

LoopSimulation::LoopSimulation(const PlantModel& plant, const Bank& bank,
                               const ResidualFilter& filter)
    : filter_(filter), m_(plant.m()), C_(plant.C) {
  const auto k = std::ssize(plant.faults);
  const auto l = std::ssize(plant.disturbances);
  MatrixXd inputs(plant.n(), m_ + k + l);
  D_ = MatrixXd(plant.q(), inputs.cols());
  inputs.leftCols(m_) = plant.B;
  D_.leftCols(m_) = plant.D;
  for (Index j = 0; j < k; ++j) {
    inputs.col(m_ + j) = plant.faults[static_cast<std::size_t>(j)].state;
    D_.col(m_ + j) = plant.faults[static_cast<std::size_t>(j)].output;
  }
  for (Index i = 0; i < l; ++i) {
    inputs.col(m_ + k + i) = plant.disturbances[static_cast<std::size_t>(i)].state;
    D_.col(m_ + k + i) = plant.disturbances[static_cast<std::size_t>(i)].output;
  }
  const SampledSystem sampled = plant.time == TimeDomain::kDiscrete
                                    ? SampledSystem{plant.A, inputs}
                                    : discretize_zoh(plant.A, inputs, bank.sample_time_s);
  A_ = sampled.A;
  B_ = sampled.B;
  x_ = VectorXd::Zero(A_.rows());
  v_ = VectorXd::Zero(filter.F.rows());
}

VectorXd LoopSimulation::step(const VectorXd& w) {
  const VectorXd y = C_ * x_ + D_ * w;
  const VectorXd u = w.head(m_);
  const VectorXd r = filter_.M * v_ - filter_.H * y + filter_.K * u;
  v_ = (filter_.F * v_ - filter_.E * y + filter_.G * u).eval();
  x_ = (A_ * x_ + B_ * w).eval();
  return r;
}

}  // namespace faultline

#include "diagnosis/certify/sampled_plant.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include <Eigen/LU>
#include <Eigen/QR>

#include "diagnosis/certify/balance.h"
#include "diagnosis/certify/ordered_schur.h"
#include "diagnosis/certify/plant_step.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;
using Complex = std::complex<double>;

// Modes slower than this per sample are split off: until then y grows to 1e4 times its input, and
// that costs no more than four digits.
constexpr double kSlowMode = 1e-4;
// A mode that the filter does not cancel is felt as at this distance: what a million samples at
// resonance make of it.
constexpr double kNearestMode = 1e-6;
// Rates below this, per sample, are integrators.
constexpr double kSlowestRate = 1e-6;
constexpr int kGridPoints = 40;
// The grid begins this far below the slowest rate.
constexpr double kBelowSlowest = 1e-3;
// Damping from which on a mode has no peak: 1/√2.
constexpr double kNoPeak = std::numbers::sqrt2 / 2.0;

// All directions of inputs, faults and disturbances.
struct Inputs {
  MatrixXd state, output;
};

Inputs all_inputs(const PlantModel& plant) {
  const Index m = plant.m();
  const auto k = std::ssize(plant.faults);
  const auto l = std::ssize(plant.disturbances);
  Inputs inputs{MatrixXd(plant.n(), m + k + l), MatrixXd(plant.q(), m + k + l)};
  inputs.state.leftCols(m) = plant.B;
  inputs.output.leftCols(m) = plant.D;
  Index j = m;
  for (const Fault& fault : plant.faults) {
    inputs.state.col(j) = fault.state;
    inputs.output.col(j++) = fault.output;
  }
  for (const Disturbance& disturbance : plant.disturbances) {
    inputs.state.col(j) = disturbance.state;
    inputs.output.col(j++) = disturbance.output;
  }
  return inputs;
}

std::vector<Index> treated(const Bank& bank, BankDisturbance::Treatment treatment) {
  std::vector<Index> indices;
  for (std::size_t i = 0; i < bank.disturbances.size(); ++i) {
    if (bank.disturbances[i].treatment == treatment) {
      indices.push_back(static_cast<Index>(i));
    }
  }
  return indices;
}

bool is_resonant(Complex mode) {
  if (mode.imag() <= 0.0) {
    return false;
  }
  const Complex rate = std::log(mode);
  return std::abs(rate.real()) < kNoPeak * std::abs(rate);
}

}  // namespace

DomainModel domain_model(const PlantModel& plant, const Bank& bank) {
  const Inputs inputs = all_inputs(plant);
  DomainModel model;
  model.is_sampled = is_sampled(bank.domain) || plant.time == TimeDomain::kDiscrete;
  MatrixXd states = inputs.state;
  model.A = plant.A;
  if (model.is_sampled) {
    const VectorXd scales = state_scales(plant.A, inputs.state, plant.C);
    const SampledSystem system = plant_step(plant, bank, inputs.state, scales);
    model.A = scales.asDiagonal() * system.A * scales.cwiseInverse().asDiagonal();
    states = scales.asDiagonal() * system.B;
  }
  const Index m = plant.m();
  const auto k = std::ssize(plant.faults);
  model.B = states.leftCols(m);
  model.C = plant.C;
  model.D = plant.D;
  model.fault_states = states.middleCols(m, k);
  model.fault_outputs = inputs.output.middleCols(m, k);
  const auto pick = [&](const MatrixXd& all, BankDisturbance::Treatment treatment) {
    const std::vector<Index> indices = treated(bank, treatment);
    MatrixXd picked(all.rows(), std::ssize(indices));
    for (Index i = 0; i < picked.cols(); ++i) {
      picked.col(i) = all.col(m + k + indices[static_cast<std::size_t>(i)]);
    }
    return picked;
  };
  model.decoupled_states = pick(states, BankDisturbance::Treatment::kDecoupled);
  model.decoupled_outputs = pick(inputs.output, BankDisturbance::Treatment::kDecoupled);
  model.constant_states = pick(states, BankDisturbance::Treatment::kConstant);
  model.constant_outputs = pick(inputs.output, BankDisturbance::Treatment::kConstant);
  return model;
}

SampledPlant::SampledPlant(const PlantModel& plant, const Bank& bank, double largest_radius)
    : fault_begin_(plant.m()), fault_count_(std::ssize(plant.faults)) {
  const Inputs inputs = all_inputs(plant);
  const VectorXd scales = state_scales(plant.A, inputs.state, plant.C);
  const SampledSystem system = plant_step(plant, bank, inputs.state, scales);
  D_ = inputs.output;
  split(system.A, system.B, plant.C * scales.asDiagonal(), largest_radius);
  coordinates_ = coordinates_ * scales.cwiseInverse().asDiagonal();
}

void SampledPlant::split(const MatrixXd& A, const MatrixXd& B, const MatrixXd& C,
                         double largest_radius) {
  const double border = std::max(1.0 - kSlowMode, 0.5 * (1.0 + largest_radius));
  ComplexTriangle schur = complex_schur(A);
  const VectorXcd modes = schur.T.diagonal();
  // Near the unit circle first, so that what a filter cancels stands in columns of its own.
  sort_triangle(schur, [border](Complex mode) {
    const double radius = std::abs(mode);
    return radius >= border ? std::abs(radius - 1.0) : std::numeric_limits<double>::infinity();
  });
  const auto n = A.rows();
  const auto n_1 = (schur.T.diagonal().cwiseAbs().array() >= border).count();
  // The subspace is real: its real and imaginary parts span it.
  MatrixXd Q = MatrixXd::Identity(n, n);
  if (n_1 > 0) {
    MatrixXd parts(n, 2 * n_1);
    parts << schur.U.leftCols(n_1).real(), schur.U.leftCols(n_1).imag();
    const Eigen::ColPivHouseholderQR<MatrixXd> qr(parts);
    Q = qr.householderQ() * MatrixXd::Identity(n, n);
  }
  coordinates_ = Q.transpose();
  const MatrixXd A_q = Q.transpose() * A * Q;
  const MatrixXd B_q = Q.transpose() * B;
  const MatrixXd C_q = C * Q;
  const Index n_2 = n - n_1;
  A_11_ = A_q.topLeftCorner(n_1, n_1);
  A_12_ = A_q.topRightCorner(n_1, n_2);
  A_22_ = A_q.bottomRightCorner(n_2, n_2);
  B_1_ = B_q.topRows(n_1);
  B_2_ = B_q.bottomRows(n_2);
  C_1_ = C_q.leftCols(n_1);
  C_2_ = C_q.rightCols(n_2);
  Z_ = Q.leftCols(n_1).transpose() * schur.U.leftCols(n_1);
  T_ = schur.T.topLeftCorner(n_1, n_1);
  choose_angles(modes);
}

void SampledPlant::choose_angles(const VectorXcd& modes) {
  constexpr double kPi = std::numbers::pi;
  double slowest = kPi;
  for (const Complex mode : modes) {
    const double rate = mode == 0.0 ? kPi : std::abs(std::log(mode));
    if (rate > kSlowestRate) {
      slowest = std::min(slowest, rate);
    }
  }
  const double first = kBelowSlowest * slowest;
  angles_ = resonances(modes);
  angles_.push_back(0.0);
  angles_.push_back(kPi);
  for (int i = 0; i < kGridPoints; ++i) {
    angles_.push_back(first * std::pow(kPi / first, static_cast<double>(i) / kGridPoints));
  }
  std::sort(angles_.begin(), angles_.end());
}

MatrixXd SampledPlant::fault_outputs() const { return D_.middleCols(fault_begin_, fault_count_); }

MatrixXd SampledPlant::fault_first_outputs() const {
  return C_1_ * B_1_.middleCols(fault_begin_, fault_count_) +
         C_2_ * B_2_.middleCols(fault_begin_, fault_count_);
}

const SampledPlant::Response& SampledPlant::at(double angle) {
  const auto found = responses_.find(angle);
  if (found != responses_.end()) {
    return found->second;
  }
  const Complex z = angle == 0.0                ? Complex(1.0)
                    : angle == std::numbers::pi ? Complex(-1.0)
                                                : std::polar(1.0, angle);
  Response response;
  const Index n_2 = A_22_.rows();
  response.y_2 = D_.cast<Complex>();
  response.s_1 = B_1_.cast<Complex>();
  if (n_2 > 0) {
    const MatrixXcd pencil = z * MatrixXcd::Identity(n_2, n_2) - A_22_;
    const MatrixXcd xi_2 = pencil.partialPivLu().solve(B_2_.cast<Complex>());
    response.y_2 += C_2_ * xi_2;
    response.s_1 += A_12_ * xi_2;
  }
  response.xi_1 = Z_.adjoint() * response.s_1;
  const Index n_1 = T_.rows();
  if (n_1 > 0) {
    // Of n_1 + 2 places further out one is kNearestMode away from every mode.
    const auto distance = [&](Complex place) {
      return (T_.diagonal().array() - place).abs().minCoeff();
    };
    Complex place = z;
    for (Index i = 1; distance(place) < 0.5 * kNearestMode && i < n_1 + 2; ++i) {
      place = z * (1.0 + static_cast<double>(i) * kNearestMode);
    }
    const MatrixXcd pencil = place * MatrixXcd::Identity(n_1, n_1) - T_;
    pencil.triangularView<Eigen::Upper>().solveInPlace(response.xi_1);
  }
  return responses_.emplace(angle, std::move(response)).first->second;
}

SampledPlant::FaultStep::FaultStep(const SampledPlant& plant)
    : plant_(plant), xi_2_(MatrixXd::Zero(plant.A_22_.rows(), plant.fault_count_)) {
  update();
}

void SampledPlant::FaultStep::update() {
  const auto faults = [this](const MatrixXd& X) {
    return X.middleCols(plant_.fault_begin_, plant_.fault_count_);
  };
  y_2_ = faults(plant_.D_);
  y_2_.noalias() += plant_.C_2_ * xi_2_;
  s_1_ = faults(plant_.B_1_);
  s_1_.noalias() += plant_.A_12_ * xi_2_;
}

void SampledPlant::FaultStep::advance() {
  next_ = plant_.B_2_.middleCols(plant_.fault_begin_, plant_.fault_count_);
  next_.noalias() += plant_.A_22_ * xi_2_;
  xi_2_.swap(next_);
  update();
}

std::vector<double> resonances(const VectorXcd& modes) {
  // Nine digits: far sharper than any resonance that is worth looking at.
  constexpr double kDigits = 1e9;
  std::vector<double> angles;
  for (const Complex mode : modes) {
    if (is_resonant(mode)) {
      angles.push_back(std::min(std::numbers::pi, std::round(std::arg(mode) * kDigits) / kDigits));
    }
  }
  return angles;
}

}  // namespace faultline

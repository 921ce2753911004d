#include "diagnosis/certify/filter_loop.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "diagnosis/certify/balance.h"
#include "diagnosis/certify/ordered_schur.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Complex = std::complex<double>;

// Rounding errors of these sums stay below 1e-12 of their terms: 1e-16 per operation, amplified at
// most 1e4 times by the plant's slowest mode that is not split off.
constexpr double kRoundingError = 1e-11;
// A column of N_1 below this part of its terms is cancelled: the error of V_1 is that of a solution
// whose condition is 2/(1 - ρ(F)), and gains of 1e-9 of the possible could not be told from zero.
constexpr double kCancelled = 1e-9;
// Angles below the filter's band at which its band gain is looked at, too.
constexpr std::array kBandFractions = {1.0, 0.5, 0.25, 0.1};

}  // namespace

double rounding_error(double possible) { return kRoundingError * possible; }

FilterLoop::FilterLoop(SampledPlant& plant, const ResidualFilter& filter)
    : plant_(plant), evaluation_(filter), H_(filter.H), K_(filter.K), J_(filter.J) {
  MatrixXd inputs(filter.F.rows(), filter.E.cols() + filter.G.cols());
  inputs << filter.E, filter.G;
  const VectorXd scales = state_scales(filter.F, inputs, filter.M);
  const VectorXd inverse = scales.cwiseInverse();
  F_ = inverse.asDiagonal() * filter.F * scales.asDiagonal();
  E_ = inverse.asDiagonal() * filter.E;
  G_ = inverse.asDiagonal() * filter.G;
  L_ = inverse.asDiagonal() * filter.L;
  M_ = filter.M * scales.asDiagonal();
  reduce();
}

void FilterLoop::reduce() {
  ComplexTriangle schur = complex_schur(F_);
  T_ = std::move(schur.T);
  Q_ = std::move(schur.U);
  radius_ = T_.size() == 0 ? 0.0 : T_.diagonal().cwiseAbs().maxCoeff();
  solve_sylvester();
  M_q_ = M_ * Q_;
  MatrixXd inputs(F_.rows(), E_.cols() + G_.cols() + V_1_.cols() + L_.cols());
  inputs << E_, G_, V_1_, L_;
  inputs_q_ = Q_.adjoint() * inputs;
}

// F V_1 - V_1 A_11 = E C_1, column by column in the triangular coordinates of both: Golub, Van
// Loan, Matrix Computations, 4th ed., 7.6.3. No eigenvalue is shared: |λ(F)| < |λ(A_11)|.
void FilterLoop::solve_sylvester() {
  const Index d = F_.rows();
  const Index n_1 = plant_.T().rows();
  MatrixXcd V = Q_.adjoint() * (E_ * plant_.C_1()) * plant_.Z();
  for (Index j = 0; j < n_1; ++j) {
    for (Index i = 0; i < j; ++i) {
      V.col(j) += V.col(i) * plant_.T()(i, j);
    }
    const MatrixXcd pencil = T_ - plant_.T()(j, j) * MatrixXcd::Identity(d, d);
    pencil.triangularView<Eigen::Upper>().solveInPlace(V.col(j));
  }
  V_1_ = (Q_ * V * plant_.Z().adjoint()).real();
  const MatrixXcd seen = M_ * (Q_ * V);
  const MatrixXcd measured = H_ * (plant_.C_1() * plant_.Z());
  N_1_ = seen - measured;
  for (Index j = 0; j < n_1; ++j) {
    const double terms = M_.norm() * V.col(j).norm() + measured.col(j).norm();
    if (N_1_.col(j).norm() <= kCancelled * terms) {
      N_1_.col(j).setZero();
    }
  }
}

FilterLoop::Gains FilterLoop::at(double angle) const {
  const SampledPlant::Response& plant = plant_.at(angle);
  const Complex z = angle == 0.0                ? Complex(1.0)
                    : angle == std::numbers::pi ? Complex(-1.0)
                                                : std::polar(1.0, angle);
  const Index d = T_.rows();
  const Index q = E_.cols();
  const Index m = G_.cols();
  const Index n_1 = V_1_.cols();
  const Index k = L_.cols();
  // [W E, W G, W V_1, W L] with W = M (zI - F)⁻¹.
  MatrixXcd W = M_q_;
  if (d > 0) {
    const MatrixXcd pencil = z * MatrixXcd::Identity(d, d) - T_;
    pencil.triangularView<Eigen::Upper>().solveInPlace<Eigen::OnTheRight>(W);
  }
  MatrixXcd through = MatrixXcd::Zero(H_.rows(), q + m + n_1 + k);
  through.noalias() += W * inputs_q_;
  const MatrixXcd from_y = through.leftCols(q) + H_;
  const MatrixXcd from_u = through.middleCols(q, m) + K_;
  const MatrixXcd from_s = through.middleCols(q + m, n_1);
  const MatrixXcd from_m = through.rightCols(k) + J_;

  MatrixXcd T = MatrixXcd::Zero(H_.rows(), plant_.inputs());
  T.noalias() -= from_y * plant.y_2;
  T.noalias() -= from_s * plant.s_1;
  T.noalias() += N_1_ * plant.xi_1;
  T.leftCols(m) += from_u;

  Gains gains;
  gains.gain = T.colwise().norm().transpose();
  gains.possible =
      (through.leftCols(q).norm() + H_.norm()) * plant.y_2.colwise().norm().transpose() +
      from_s.norm() * plant.s_1.colwise().norm().transpose() +
      N_1_.norm() * plant.xi_1.colwise().norm().transpose();
  gains.possible.head(m) +=
      through.middleCols(q, m).colwise().norm().transpose() + K_.colwise().norm().transpose();
  gains.stored_gain = from_m.colwise().norm().transpose();
  gains.fault_response = T.middleCols(m, k);
  gains.internal_error = (T.middleCols(m, k) + from_m).colwise().norm().transpose();
  return gains;
}

FilterLoop::ExactResponse FilterLoop::exact_response(DesignDomain domain) const {
  const MatrixXd D_f = plant_.fault_outputs();
  const VectorXd direct = (J_ - H_ * D_f).colwise().norm().transpose();
  if (domain == DesignDomain::kContinuous) {
    const Gains dc = at(0.0);
    const VectorXd possible = dc.possible.segment(G_.cols(), L_.cols()) + dc.stored_gain;
    return {direct.cwiseMax(dc.internal_error), possible.unaryExpr(&rounding_error)};
  }
  const MatrixXd C_L = plant_.fault_first_outputs();
  const MatrixXd next = M_ * L_ - H_ * C_L - M_ * (E_ * D_f);
  const VectorXd terms =
      H_.norm() * (D_f.colwise().norm() + C_L.colwise().norm()).transpose() +
      M_.norm() * (L_.colwise().norm() + E_.norm() * D_f.colwise().norm()).transpose();
  return {direct.cwiseMax(next.colwise().norm().transpose()), kRoundingError * terms};
}

std::vector<double> FilterLoop::own_angles() const {
  std::vector<double> angles = resonances(T_.diagonal());
  for (const double fraction : kBandFractions) {
    angles.push_back(fraction * band());
  }
  return angles;
}

double FilterLoop::band() const {
  // Nine digits: equal poles of different filters give equal angles.
  constexpr double kDigits = 1e9;
  const double rate = radius_ > 0.0 ? -std::log(radius_) : std::numbers::pi;
  return rate >= std::numbers::pi ? std::numbers::pi
                                  : std::max(std::round(rate * kDigits), 1.0) / kDigits;
}

StableSystem FilterLoop::stacked(Source source) const {
  const Index d = F_.rows();
  const Index n_2 = plant_.A_22().rows();
  StableSystem system;
  system.A = MatrixXd::Zero(d + n_2, d + n_2);
  system.A << F_, -E_ * plant_.C_2() - V_1_ * plant_.A_12(), MatrixXd::Zero(n_2, d), plant_.A_22();
  system.C.resize(H_.rows(), d + n_2);
  system.C << M_, -H_ * plant_.C_2();
  switch (source) {
    case Source::kPlant: {
      const Index m = G_.cols();
      system.B.resize(d + n_2, plant_.inputs());
      system.B << -E_ * plant_.D() - V_1_ * plant_.B_1(), plant_.B_2();
      system.B.topLeftCorner(d, m) += G_;
      system.D = -H_ * plant_.D();
      system.D.leftCols(m) += K_;
      break;
    }
    case Source::kOutput:
      system.B = MatrixXd::Zero(d + n_2, E_.cols());
      system.B.topRows(d) = -E_;
      system.D = -H_;
      break;
    case Source::kState: {
      const MatrixXd& split = plant_.coordinates();
      const Index n_1 = V_1_.cols();
      system.B.resize(d + n_2, split.cols());
      system.B << -V_1_ * split.topRows(n_1), split.bottomRows(n_2);
      system.D = MatrixXd::Zero(H_.rows(), split.cols());
      break;
    }
  }
  return system;
}

MatrixXd FilterLoop::uncancelled() const {
  const MatrixXcd in_modes = plant_.Z().adjoint() * plant_.coordinates().topRows(V_1_.cols());
  return (N_1_ * in_modes).real();
}

FilterLoop::FaultStep::FaultStep(const SampledPlant& plant, const FilterLoop& loop)
    : loop_(loop), plant_(plant), e_(MatrixXd::Zero(loop.F_.rows(), loop.L_.cols())) {}

const VectorXd& FilterLoop::FaultStep::advance() {
  r_ = MatrixXd::Zero(loop_.H_.rows(), e_.cols());
  r_.noalias() += loop_.M_ * e_;
  r_.noalias() -= loop_.H_ * plant_.y_2();
  next_ = MatrixXd::Zero(e_.rows(), e_.cols());
  next_.noalias() += loop_.F_ * e_;
  next_.noalias() -= loop_.E_ * plant_.y_2();
  next_.noalias() -= loop_.V_1_ * plant_.s_1();
  e_.swap(next_);
  plant_.advance();
  evaluations_.resize(r_.cols());
  for (Index j = 0; j < r_.cols(); ++j) {
    evaluations_[j] = loop_.evaluation_.of(r_.col(j));
  }
  return evaluations_;
}

}  // namespace faultline

#include "diagnosis/design/uio/observer_inequalities.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include <fmt/core.h>

namespace faultline {
namespace {

/// A column of a product below this, relative to its factors, is rounding: S M of a decoupled
/// disturbance.
constexpr double kZeroColumn = 1e-10;
/// Ends of a band that are meant to be 0 or π, in rad.
constexpr double kBandEnd = 1e-12;

Eigen::MatrixXd columns(const Eigen::MatrixXd& M, const std::vector<Eigen::Index>& which) {
  Eigen::MatrixXd some(M.rows(), static_cast<Eigen::Index>(which.size()));
  for (std::size_t j = 0; j < which.size(); ++j) {
    some.col(static_cast<Eigen::Index>(j)) = M.col(which[j]);
  }
  return some;
}

/// Largest of the columns' norms.
double largest_column(const Eigen::MatrixXd& M) {
  return M.size() > 0 ? M.colwise().norm().maxCoeff() : 0.0;
}

/// How large the residual is, within n samples and without a gain, of what enters the error by B
/// and the residual by D: a size that does not depend on the units of the states. One if it is
/// zero.
double residual_size(const ErrorData& data, Eigen::MatrixXd B, const Eigen::MatrixXd& D) {
  double size = largest_column(D);
  for (Eigen::Index k = 0; k < data.model.n(); ++k) {
    size = std::max(size, largest_column(data.output.R * B));
    B = data.decoupling.S * data.model.A * B;
  }
  return size > 0.0 ? size : 1.0;
}

/// A variable Hermitian matrix, or a symmetric one if the band's form is real.
AffineMatrix form_variable(LmiProblem& problem, const BandForm& form, Eigen::Index n) {
  return form.is_complex() ? problem.hermitian(n) : problem.symmetric(n);
}

}  // namespace

ErrorData::ErrorData(const ObserverModel& observer_model, const DecouplingMatrices& matrices,
                     const ObserverOutput& observer_output)
    : model(observer_model), decoupling(matrices), output(observer_output) {
  Eigen::MatrixXd SM = decoupling.S * model.M;
  w_size =
      residual_size(*this, SM * model.w_bound.asDiagonal(), output.Q * model.w_bound.asDiagonal());
  w_unit = model.w_bound / w_size;
  SM = SM * w_unit.asDiagonal();
  const Eigen::MatrixXd W = model.W * w_unit.asDiagonal();
  const Eigen::MatrixXd TW = decoupling.T * W;
  const Eigen::MatrixXd Q = output.Q * w_unit.asDiagonal();
  for (Eigen::Index j = 0; j < W.cols(); ++j) {
    const double M_size = decoupling.S.norm() * model.M.col(j).norm() * w_unit[j];
    if (SM.col(j).norm() <= kZeroColumn * M_size) SM.col(j).setZero();
    if (!SM.col(j).isZero(0.0) || !W.col(j).isZero(0.0)) now.push_back(j);
    if (TW.col(j).norm() > kZeroColumn * decoupling.T.norm() * W.col(j).norm()) next.push_back(j);
    if (!Q.col(j).isZero(0.0)) direct.push_back(j);
  }
  SM_now = columns(SM, now);
  W_now = columns(W, now);
  TW_next = columns(TW, next);
  Q_direct = columns(Q, direct);
  SF_x = decoupling.S * model.F_x;
  fault_size = residual_size(*this, SF_x, output.J);
  SF_x /= fault_size;
  F_y = model.F_y / fault_size;
  J = output.J / fault_size;
  for (Eigen::Index v = 0; v < model.vertex_count(); ++v) {
    bool is_repeated = false;  // one without this bit is the same
    for (Eigen::Index i = 0; i < model.slope_radius.size(); ++i) {
      is_repeated = is_repeated || (((v >> i) & 1) != 0 && model.slope_radius[i] == 0.0);
    }
    if (!is_repeated) vertices.emplace_back(decoupling.S * model.vertex(v));
  }
}

BoundVariables add_bound_variables(LmiProblem& problem, const ErrorData& data) {
  AffineMatrix P = problem.symmetric(data.model.n());
  AffineMatrix mu_now = problem.full(data.SM_now.cols(), 1);
  AffineMatrix mu_next = problem.full(data.TW_next.cols(), 1);
  AffineMatrix mu_direct = problem.full(data.Q_direct.cols(), 1);
  return {std::move(P), std::move(mu_now), std::move(mu_next), std::move(mu_direct)};
}

AffineMatrix sum_of_multipliers(const BoundVariables& bound) {
  AffineMatrix sum(1, 1);
  for (const AffineMatrix* mu : {&bound.mu_now, &bound.mu_next, &bound.mu_direct}) {
    sum += Eigen::MatrixXd::Ones(1, mu->rows()) * *mu;
  }
  return sum;
}

void require_output_bound(LmiProblem& problem, const ErrorData& data, const BoundVariables& bound,
                          const AffineMatrix& X) {
  const Eigen::MatrixXd& R = data.output.R;
  const Eigen::MatrixXd& Q = data.Q_direct;
  problem.require_negative("output bound",
                           hermitian({{R.transpose() * X * R - bound.P, R.transpose() * X * Q},
                                      {Q.transpose() * X * Q - diagonal(bound.mu_direct)}}));
}

void require_error_bound(LmiProblem& problem, const ErrorData& data, const BoundVariables& bound,
                         const AffineMatrix& G, const AffineMatrix& Y, double alpha) {
  const Eigen::Index n = data.model.n();
  const AffineMatrix GN = G * (data.decoupling.S * data.model.A) - Y * data.model.C;
  const AffineMatrix GB_now = G * data.SM_now - Y * data.W_now;
  const AffineMatrix GB_next = -(G * data.TW_next);
  const Eigen::Index now = GB_now.cols();
  const Eigen::Index next = GB_next.cols();
  for (const Eigen::MatrixXd& vertex : data.vertices) {
    const AffineMatrix GA = GN + G * vertex;
    problem.require_negative(
        "error bound",
        hermitian({{-alpha * bound.P, {n, now}, {n, next}, GA.adjoint()},
                   {-(1.0 - alpha) * diagonal(bound.mu_now), {now, next}, GB_now.adjoint()},
                   {-(1.0 - alpha) * diagonal(bound.mu_next), GB_next.adjoint()},
                   {bound.P - hermitian_part_twice(G)}}));
  }
}

void require_error_bound(LmiProblem& problem, const ErrorData& data, const BoundVariables& bound,
                         const Eigen::MatrixXd& gain, double alpha) {
  const Eigen::Index n = data.model.n();
  Eigen::MatrixXd AB(n, n + data.SM_now.cols() + data.TW_next.cols());
  const Eigen::MatrixXd N = data.decoupling.S * data.model.A - gain * data.model.C;
  const Eigen::Index now = data.SM_now.cols();
  const Eigen::Index next = data.TW_next.cols();
  for (const Eigen::MatrixXd& vertex : data.vertices) {
    AB << N + vertex, data.SM_now - gain * data.W_now, -data.TW_next;
    const AffineMatrix right = hermitian({{alpha * bound.P, {n, now}, {n, next}},
                                          {(1.0 - alpha) * diagonal(bound.mu_now), {now, next}},
                                          {(1.0 - alpha) * diagonal(bound.mu_next)}});
    problem.require_negative("error bound", AB.transpose() * bound.P * AB - right);
  }
}

BandForm band_form(const FrequencyBand& band) {
  const double pi = std::numbers::pi;
  if (!(band.low_rad >= 0.0 && band.low_rad <= band.high_rad && band.high_rad <= pi + kBandEnd)) {
    throw std::invalid_argument(
        fmt::format("frequency band [{}, {}] rad per sample; expected 0 <= low <= high <= pi",
                    band.low_rad, band.high_rad));
  }
  const bool is_low = band.low_rad <= kBandEnd;
  const bool is_high = band.high_rad >= pi - kBandEnd;
  if (is_low && is_high) return {0.0, 0.0};
  if (is_low) return {1.0, -2.0 * std::cos(band.high_rad)};
  if (is_high) return {-1.0, 2.0 * std::cos(band.low_rad)};
  return {std::polar(1.0, 0.5 * (band.low_rad + band.high_rad)),
          -2.0 * std::cos(0.5 * (band.high_rad - band.low_rad))};
}

void require_h_minus(LmiProblem& problem, const ErrorData& data, const AffineMatrix& X,
                     const AffineMatrix& G, const AffineMatrix& Y, const FrequencyBand& band,
                     const ReferenceSystem& reference) {
  const BandForm form = band_form(band);
  const Eigen::Index n = data.model.n();
  const Eigen::Index f = data.model.F_x.cols();
  const double a_0 = reference.a_0;
  const Eigen::MatrixXd V = reference.V / data.fault_size;
  const Eigen::MatrixXd& R = data.output.R;
  const Eigen::MatrixXd& J = data.J;

  const AffineMatrix P_f = form_variable(problem, form, n);
  AffineMatrix Q(n, n);
  if (!form.is_full()) {
    Q = form_variable(problem, form, n);
    problem.require_positive("band multiplier", Q);
  }
  const AffineMatrix GN = G * (data.decoupling.S * data.model.A) - Y * data.model.C;
  const AffineMatrix GF = G * data.SF_x - Y * data.F_y;
  const AffineMatrix RXR = R.transpose() * X * R;
  const AffineMatrix RXJ = R.transpose() * X * J;
  const AffineMatrix JXJ = J.transpose() * X * J;
  for (const Eigen::MatrixXd& vertex : data.vertices) {
    const AffineMatrix GA = GN + G * vertex;
    problem.require_negative(
        "fault sensitivity",
        hermitian({{-P_f - hermitian_part_twice(G), a_0 * G.adjoint() + form.s_1 * Q + GA,
                    GF - G.adjoint() * V},
                   {P_f + form.s_2 * Q - RXR - a_0 * hermitian_part_twice(GA),
                    GA.adjoint() * V - a_0 * GF - RXJ},
                   {AffineMatrix(Eigen::MatrixXd::Identity(f, f)) - JXJ +
                    hermitian_part_twice(V.transpose() * GF)}}));
  }
}

}  // namespace faultline

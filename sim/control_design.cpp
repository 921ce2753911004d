#include "sim/control_design.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <fmt/format.h>

#include "diagnosis/model/discretize.h"
#include "diagnosis/model/riccati.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Pole = std::complex<double>;

/// Half the width of the central difference that gives a slope: truncation (h²) and rounding (ε/h)
/// both stay below 1e-9 for functions of size one.
constexpr double kSlopeStep = 1e-6;
/// Eigenvalues of a double integrator are known to √ε = 1e-8 only: a mode counts as not decaying,
/// and a rank as lost, within ten times that.
constexpr double kModeTolerance = 1e-7;
/// NoiseCovariances: share of an input's range that is unknown, and of an output's that is misread.
constexpr double kInputDoubt = 0.01;
constexpr double kOutputDoubt = 0.001;

double slope_at_zero(const NonlinearFunction& function) {
  return (evaluate(function, kSlopeStep) - evaluate(function, -kSlopeStep)) / (2.0 * kSlopeStep);
}

MatrixXd linearised_A(const PlantModel& model) {
  MatrixXd A = model.A;
  for (const Nonlinearity& term : model.nonlinearities) {
    A += term.gain * slope_at_zero(term.function) * term.E_o * term.E_i.transpose();
  }
  return A;
}

/// Columns that enter the state equation, sampled.
MatrixXd sample_columns(const PlantModel& model, const MatrixXd& E, double sample_time_s) {
  if (model.time == TimeDomain::kDiscrete || E.cols() == 0) return E;
  return discretize_zoh(linearised_A(model), E, sample_time_s).B;
}

/// A mode of A that C does not see and that does not decay, if there is one.
struct HiddenMode {
  Pole pole;
  Index state;  ///< that it moves most
};
std::optional<HiddenMode> find_hidden_mode(const MatrixXd& A, const MatrixXd& C) {
  const Index n = A.rows();
  for (const Pole& pole : poles_of(A)) {
    if (std::abs(pole) < 1.0 - kModeTolerance) continue;
    MatrixXcd pencil(n + C.rows(), n);
    pencil << A.cast<Pole>() - pole * MatrixXcd::Identity(n, n), C.cast<Pole>();
    const Eigen::JacobiSVD<MatrixXcd> svd(pencil, Eigen::ComputeThinV);
    if (svd.singularValues()[n - 1] > kModeTolerance * svd.singularValues()[0]) continue;
    Index state = 0;
    svd.matrixV().col(n - 1).cwiseAbs().maxCoeff(&state);
    return HiddenMode{pole, state};
  }
  return std::nullopt;
}

std::string pole_text(const Pole& pole) {
  if (pole.imag() == 0.0) return fmt::format("{:.6g}", pole.real());
  return fmt::format("{:.6g}{:+.6g}i", pole.real(), pole.imag());
}

void refuse_hidden_mode(const MatrixXd& A, const MatrixXd& C,
                        const std::vector<std::string>& state_names, const char* what) {
  const auto mode = find_hidden_mode(A, C);
  if (!mode) return;
  throw std::invalid_argument(
      fmt::format("found the mode at {} per sample (|.| = {:.6g}), mostly of state \"{}\", {}",
                  pole_text(mode->pole), std::abs(mode->pole),
                  state_names[static_cast<std::size_t>(mode->state)], what));
}

VectorXd range_or_one(const VectorXd& range, Index size) {
  return range.size() == size ? range : VectorXd(VectorXd::Ones(size));
}

/// Variance of a value spread evenly within ±bound.
double uniform_variance(double bound) { return bound * bound / 3.0; }

/// S M, S picking rows.
MatrixXd pick_rows(const MatrixXd& M, const std::vector<Index>& rows) {
  MatrixXd picked(static_cast<Index>(rows.size()), M.cols());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    picked.row(static_cast<Index>(i)) = M.row(rows[i]);
  }
  return picked;
}

}  // namespace

DiscretePlant sample_plant(const PlantModel& model, double sample_time_s) {
  const MatrixXd A = linearised_A(model);
  if (model.time == TimeDomain::kDiscrete) return {A, model.B, model.C, model.D};
  SampledSystem sampled = discretize_zoh(A, model.B, sample_time_s);
  return {std::move(sampled.A), std::move(sampled.B), model.C, model.D};
}

LinearController static_controller(const MatrixXd& J) {
  return {MatrixXd(0, 0), MatrixXd(0, J.cols()), MatrixXd(J.rows(), 0), J};
}

std::vector<Pole> poles_of(const MatrixXd& A) {
  const Eigen::VectorXcd values = A.eigenvalues();
  std::vector<Pole> poles(values.begin(), values.end());
  std::sort(poles.begin(), poles.end(), [](const Pole& a, const Pole& b) {
    if (std::abs(a) != std::abs(b)) return std::abs(a) > std::abs(b);
    return a.imag() > b.imag();
  });
  return poles;
}

std::vector<Pole> closed_loop_poles(const DiscretePlant& plant,
                                    const LinearController& controller) {
  const Index n = plant.A.rows(), m = plant.B.cols(), p = controller.F.rows();
  MatrixXd loop(n + m + p, n + m + p);
  loop.topRows(n) << plant.A, plant.B, MatrixXd::Zero(n, p);
  loop.middleRows(n, m) << controller.J * plant.C, controller.J * plant.D, controller.H;
  loop.bottomRows(p) << controller.G * plant.C, controller.G * plant.D, controller.F;
  return poles_of(loop);
}

void check_detectable(const DiscretePlant& plant, const std::vector<std::string>& state_names) {
  refuse_hidden_mode(plant.A, plant.C, state_names,
                     "which no output shows, expected every mode that does not decay to be seen");
}

void check_stabilisable(const DiscretePlant& plant, const std::vector<std::string>& state_names) {
  refuse_hidden_mode(plant.A.transpose(), plant.B.transpose(), state_names,
                     "which no input moves, expected every mode that does not decay to be held");
}

NoiseCovariances noise_covariances(const PlantModel& model, double sample_time_s) {
  const Index n = model.n(), q = model.q();
  NoiseCovariances covariances{MatrixXd::Zero(n, n), MatrixXd::Zero(q, q)};
  const auto add = [&](const MatrixXd& column, const VectorXd& output, double variance) {
    const VectorXd state = sample_columns(model, column, sample_time_s);
    covariances.Q_w += variance * state * state.transpose();
    covariances.R_v += variance * output * output.transpose();
  };
  for (const Disturbance& disturbance : model.disturbances) {
    add(disturbance.state, disturbance.output, uniform_variance(disturbance.bound.value_or(0.0)));
  }
  const VectorXd doubt = kInputDoubt * range_or_one(model.input_range, model.m());
  for (Index i = 0; i < model.m(); ++i) {
    add(model.B.col(i), VectorXd::Zero(q), doubt[i] * doubt[i]);
  }
  for (const Noise& noise : model.noises) {
    const double variance =
        noise.sigma ? *noise.sigma * *noise.sigma : uniform_variance(noise.bound.value_or(0.0));
    covariances.R_v += variance * noise.output * noise.output.transpose();
  }
  const VectorXd misread = kOutputDoubt * range_or_one(model.output_range, q);
  covariances.R_v += misread.cwiseAbs2().asDiagonal();
  return covariances;
}

MatrixXd kalman_gain(const DiscretePlant& plant, const NoiseCovariances& covariances,
                     const std::vector<std::string>& state_names) {
  check_detectable(plant, state_names);
  return lqr_gain(plant.A.transpose(), plant.C.transpose(), covariances.Q_w, covariances.R_v)
      .transpose();
}

SteadyState steady_state(const DiscretePlant& plant, const std::vector<Index>& outputs) {
  const Index n = plant.A.rows(), m = plant.B.cols(), q = plant.C.rows();
  const auto picked = static_cast<Index>(outputs.size());
  MatrixXd equations(n + picked, n + m);
  equations << plant.A - MatrixXd::Identity(n, n), plant.B, pick_rows(plant.C, outputs),
      pick_rows(plant.D, outputs);
  MatrixXd right = MatrixXd::Zero(n + picked, q);
  right.bottomRows(picked) = pick_rows(MatrixXd::Identity(q, q), outputs);
  const MatrixXd solution = pseudo_inverse(equations) * right;
  return {solution.topRows(n), solution.bottomRows(m)};
}

double SteadyState::miss(const DiscretePlant& plant, const std::vector<Index>& outputs,
                         const VectorXd& r) const {
  const VectorXd x = N_x * r, u = N_u * r;
  const VectorXd y = plant.C * x + plant.D * u - r;
  const double motion = (plant.A * x + plant.B * u - x).norm();
  const double size = pick_rows(r, outputs).norm();
  return size > 0.0 ? (motion + pick_rows(y, outputs).norm()) / size : motion;
}

MatrixXd pseudo_inverse(const MatrixXd& C) {
  return Eigen::CompleteOrthogonalDecomposition<MatrixXd>(C).pseudoInverse();
}

}  // namespace faultline

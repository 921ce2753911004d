#include "diagnosis/design/uio/observer_synthesis.h"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <fmt/core.h>

#include "diagnosis/design/uio/observer_inequalities.h"

namespace faultline {
namespace {

/// τ may be so far above the solver's lower bound: J_th/β within 5 % of the best there is. The
/// exact optimum is worth less than an observer whose bound is proved all the same.
constexpr double kLargestGap = 0.1;

SynthesisStatus status_of(LmiStatus status) {
  switch (status) {
    case LmiStatus::kSolved:
      return SynthesisStatus::kSolved;
    case LmiStatus::kInfeasible:
      return SynthesisStatus::kInfeasible;
    case LmiStatus::kUnbounded:
      return SynthesisStatus::kUnbounded;
    case LmiStatus::kInaccurate:
      break;
  }
  return SynthesisStatus::kInaccurate;
}

void expect_shape(const char* what, const Eigen::MatrixXd& M, Eigen::Index rows,
                  Eigen::Index cols) {
  if (M.rows() == rows && M.cols() == cols) return;
  throw std::invalid_argument(
      fmt::format("{} is {}x{}; expected {}x{}", what, M.rows(), M.cols(), rows, cols));
}

void check_request(const ObserverModel& model, const DecouplingMatrices& decoupling,
                   const ObserverOutput& output, double alpha) {
  const Eigen::Index n = model.n();
  expect_shape("T", decoupling.T, n, model.C.rows());
  expect_shape("S", decoupling.S, n, n);
  expect_shape("x_bound", model.x_bound, n, 1);
  expect_shape("R", output.R, output.R.rows(), n);
  expect_shape("Q", output.Q, output.R.rows(), model.M.cols());
  expect_shape("J", output.J, output.R.rows(), model.F_x.cols());
  if (!(alpha > 0.0 && alpha < 1.0)) {
    throw std::invalid_argument(fmt::format("alpha = {}; expected 0 < alpha < 1", alpha));
  }
}

/// μ of all entries of w, in their units, of a column for those that enter.
Eigen::VectorXd spread(const Eigen::VectorXd& mu, const std::vector<Eigen::Index>& entries,
                       const Eigen::VectorXd& w_unit) {
  Eigen::VectorXd all = Eigen::VectorXd::Zero(w_unit.size());
  for (std::size_t j = 0; j < entries.size(); ++j) {
    const double unit = w_unit[entries[j]];
    all[entries[j]] = mu[static_cast<Eigen::Index>(j)] / (unit * unit);
  }
  return all;
}

/// P, μ, τ of the solution.
void take_bound(ObserverSynthesis& synthesis, const ErrorData& data, const LmiSolution& solution,
                const BoundVariables& bound) {
  synthesis.P = solution.value(bound.P);
  synthesis.mu_now = spread(solution.value(bound.mu_now), data.now, data.w_unit);
  synthesis.mu_next = spread(solution.value(bound.mu_next), data.next, data.w_unit);
  synthesis.mu_direct = spread(solution.value(bound.mu_direct), data.direct, data.w_unit);
  synthesis.tau = data.w_size * data.w_size * solution.value(sum_of_multipliers(bound))(0, 0);
}

/// Is `symmetric` negative definite, by more than rounding? Scaled to ones on its diagonal first.
bool is_negative_definite(const Eigen::MatrixXd& symmetric) {
  const Eigen::VectorXd diagonal = -symmetric.diagonal();
  if (!(diagonal.minCoeff() > 0.0)) return false;
  const Eigen::VectorXd D = diagonal.cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled = -(D.asDiagonal() * symmetric * D.asDiagonal());
  const auto size = static_cast<double>(symmetric.rows());
  scaled.diagonal().array() -= 4.0 * size * std::numeric_limits<double>::epsilon();
  return Eigen::LLT<Eigen::MatrixXd>(scaled).info() == Eigen::Success;
}

/// Puts the gain and P, μ back into the inequality they are to satisfy: Γ = G⁻¹ Y is a rounded
/// quotient, of which the solver knows nothing.
bool holds(const ErrorData& data, const LmiSolution& solution, const BoundVariables& bound,
           const Eigen::MatrixXd& gain, double alpha) {
  if (!gain.allFinite()) return false;
  LmiProblem analysis;
  const BoundVariables P_mu = add_bound_variables(analysis, data);
  require_error_bound(analysis, data, P_mu, gain, alpha);
  // The variables of both problems begin with P and μ, in one order.
  const Eigen::VectorXd x = solution.x.head(analysis.variable_count());
  for (const LmiProblem::Inequality& inequality : analysis.inequalities()) {
    if (!is_negative_definite(inequality.E.at(x).real())) return false;
  }
  return bound.P.rows() == P_mu.P.rows();
}

/// A request in states x' of about one, x = unit x': by it the answer does not depend on the units
/// of the states, which the solver's tolerances would feel. Powers of two, so that no digit is
/// lost; one where there is no bound.
struct ScaledRequest {
  ScaledRequest(const ObserverModel& from, const DecouplingMatrices& matrices,
                const ObserverOutput& from_output)
      : model(from), decoupling(matrices), output(from_output) {
    unit = from.x_bound.unaryExpr([](double bound) {
      return bound > 0.0 && std::isfinite(bound) ? std::exp2(std::round(std::log2(bound))) : 1.0;
    });
    const Eigen::VectorXd inverse = unit.cwiseInverse();
    model.A = inverse.asDiagonal() * from.A * unit.asDiagonal();
    model.C = from.C * unit.asDiagonal();
    model.M = inverse.asDiagonal() * from.M;
    model.F_x = inverse.asDiagonal() * from.F_x;
    model.E_o = inverse.asDiagonal() * from.E_o;
    model.E_i = from.E_i * unit.asDiagonal();
    decoupling.T = inverse.asDiagonal() * matrices.T;
    decoupling.S = inverse.asDiagonal() * matrices.S * unit.asDiagonal();
    output.R = from_output.R * unit.asDiagonal();
  }

  Eigen::VectorXd unit;
  ObserverModel model;
  DecouplingMatrices decoupling;
  ObserverOutput output;
};

/// Gain and P in the states that the caller has.
void return_units(ObserverSynthesis& synthesis, const Eigen::VectorXd& unit) {
  const Eigen::VectorXd inverse = unit.cwiseInverse();
  synthesis.gain = unit.asDiagonal() * synthesis.gain;
  synthesis.P = inverse.asDiagonal() * synthesis.P * inverse.asDiagonal();
}

ObserverSynthesis failure(SynthesisStatus status, std::string reason, double alpha) {
  ObserverSynthesis synthesis;
  synthesis.status = status;
  synthesis.reason = std::move(reason);
  synthesis.alpha = alpha;
  return synthesis;
}

/// From residuals weighted by X = UᵀU, for which β is `beta`, to the weight Ω a multiple of U,
/// tr(ΩᵀΩ) = rows: Ω is I if X is a multiple of it.
void normalise(ObserverSynthesis& synthesis, const Eigen::MatrixXd& X, double beta) {
  const double x = X.trace() / static_cast<double>(X.rows());
  synthesis.weight = Eigen::LLT<Eigen::MatrixXd>(X / x).matrixU();
  synthesis.beta = beta / std::sqrt(x);
  synthesis.P /= x;
  synthesis.mu_now /= x;
  synthesis.mu_next /= x;
  synthesis.mu_direct /= x;
  synthesis.tau /= x;
}

}  // namespace

ObserverSynthesis synthesise_observer(const ObserverModel& model,
                                      const DecouplingMatrices& decoupling,
                                      const ObserverOutput& output, double alpha,
                                      const std::optional<FrequencyBand>& band,
                                      const ReferenceSystem& reference, ResidualWeight weight) {
  check_request(model, decoupling, output, alpha);
  if (band) expect_shape("V", reference.V, model.n(), model.F_x.cols());
  const ScaledRequest scaled(model, decoupling, output);
  const ErrorData data(scaled.model, scaled.decoupling, scaled.output);
  const Eigen::Index rows = output.R.rows();
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(rows, rows);

  LmiProblem problem;
  const BoundVariables bound = add_bound_variables(problem, data);
  const AffineMatrix G = problem.full(model.n(), model.n());
  const AffineMatrix Y = problem.full(model.n(), model.C.rows());
  AffineMatrix X = one;
  if (band && weight == ResidualWeight::kFull) X = problem.symmetric(rows);
  if (band && weight == ResidualWeight::kScalar) X = multiple_of(one, problem.scalar());
  if (band) problem.require_positive("weight", X);
  require_error_bound(problem, data, bound, G, Y, alpha);
  require_output_bound(problem, data, bound, X);
  if (band) {
    const Eigen::VectorXd inverse = scaled.unit.cwiseInverse();
    require_h_minus(problem, data, X, G, Y, *band,
                    {reference.a_0, inverse.asDiagonal() * reference.V});
  }
  problem.minimise(sum_of_multipliers(bound));

  const LmiSolution solution = solve(problem, {.largest_gap = kLargestGap});
  if (!solution.is_solved()) return failure(status_of(solution.status), solution.reason, alpha);
  ObserverSynthesis synthesis;
  synthesis.alpha = alpha;
  synthesis.gain = Eigen::PartialPivLU<Eigen::MatrixXd>(solution.value(G)).solve(solution.value(Y));
  if (!holds(data, solution, bound, synthesis.gain, alpha)) {
    return failure(SynthesisStatus::kInaccurate,
                   "the gain, computed from the solution, does not satisfy the bound that the "
                   "solution proves: rounding is too large; fewer states, or states in units in "
                   "which they are of similar size",
                   alpha);
  }
  take_bound(synthesis, data, solution, bound);
  synthesis.status = SynthesisStatus::kSolved;
  synthesis.objective = std::sqrt(synthesis.tau);
  synthesis.weight = one;
  if (band) {
    synthesis.objective /= data.fault_size;
    normalise(synthesis, solution.value(X), data.fault_size);
  }
  return_units(synthesis, scaled.unit);
  return synthesis;
}

ObserverSynthesis analyse_observer(const ObserverModel& model, const DecouplingMatrices& decoupling,
                                   const ObserverOutput& output, const Eigen::MatrixXd& gain,
                                   double alpha, const Eigen::MatrixXd& weight) {
  check_request(model, decoupling, output, alpha);
  expect_shape("gain", gain, model.n(), model.C.rows());
  expect_shape("weight", weight, weight.rows(), output.R.rows());
  const ScaledRequest scaled(model, decoupling, output);
  const ErrorData data(scaled.model, scaled.decoupling, scaled.output);
  LmiProblem problem;
  const BoundVariables bound = add_bound_variables(problem, data);
  const Eigen::MatrixXd scaled_gain = scaled.unit.cwiseInverse().asDiagonal() * gain;
  require_error_bound(problem, data, bound, scaled_gain, alpha);
  require_output_bound(problem, data, bound, Eigen::MatrixXd(weight.transpose() * weight));
  problem.minimise(sum_of_multipliers(bound));
  const LmiSolution solution = solve(problem, {.largest_gap = kLargestGap});
  if (!solution.is_solved()) return failure(status_of(solution.status), solution.reason, alpha);
  ObserverSynthesis synthesis;
  take_bound(synthesis, data, solution, bound);
  synthesis.status = SynthesisStatus::kSolved;
  synthesis.alpha = alpha;
  synthesis.gain = scaled_gain;
  return_units(synthesis, scaled.unit);
  synthesis.weight = weight;
  synthesis.objective = std::sqrt(synthesis.tau);
  return synthesis;
}

}  // namespace faultline

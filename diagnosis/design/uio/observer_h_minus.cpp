#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>

#include <Eigen/LU>
#include <Eigen/SVD>

#include "diagnosis/design/uio/observer_inequalities.h"
#include "diagnosis/design/uio/observer_synthesis.h"

namespace faultline {
namespace {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;

/// Frequencies at which the transfer is looked at to scale the exact computation.
constexpr int kScalingPoints = 400;
/// β² in units of the grid's is sought below this. The exact one is at most 1.
constexpr double kLargestIndex = 4.0;

/// What the answer may give away for the inequality to be strict: a tenth of what synthesis may.
constexpr double kStrictness = 1e-9;

/// From m to Ω r at constant Λ: r = C (zI - A)⁻¹ B m + D m.
struct FaultTransfer {
  MatrixXd A, B, C, D;

  [[nodiscard]] double smallest_gain(double angle_rad) const {
    if (C.rows() < B.cols()) return 0.0;
    MatrixXcd resolvent = -A.cast<std::complex<double>>();
    resolvent.diagonal().array() += std::polar(1.0, angle_rad);
    const MatrixXcd states =
        Eigen::PartialPivLU<MatrixXcd>(resolvent).solve(B.cast<std::complex<double>>());
    const MatrixXcd gain = C * states + D;
    return Eigen::JacobiSVD<MatrixXcd>(gain).singularValues()[B.cols() - 1];
  }

  [[nodiscard]] double smallest_on_grid(const FrequencyBand& band, int points) const {
    double smallest = std::numeric_limits<double>::infinity();
    for (int i = 0; i < points; ++i) {
      const double share = points > 1 ? static_cast<double>(i) / (points - 1) : 0.0;
      const double angle = band.low_rad + share * (band.high_rad - band.low_rad);
      smallest = std::min(smallest, smallest_gain(angle));
    }
    return smallest;
  }
};

/// One per vertex.
std::vector<FaultTransfer> fault_transfers(const ObserverModel& model,
                                           const DecouplingMatrices& decoupling,
                                           const ObserverOutput& output, const MatrixXd& gain,
                                           const MatrixXd& weight) {
  const ErrorDynamics dynamics = error_dynamics(model, decoupling, gain);
  std::vector<FaultTransfer> transfers;
  for (Eigen::Index vertex = 0; vertex < model.vertex_count(); ++vertex) {
    transfers.push_back({dynamics.N + decoupling.S * model.vertex(vertex), dynamics.F_e,
                         weight * output.R, weight * output.J});
  }
  return transfers;
}

/// max b: G(e^jθ)ᴴ G(e^jθ) >= b I over the band, by the generalised KYP lemma: there are Hermitian
/// P and Q >= 0 with
///
///   -[A B]ᵀ P [A B] + [I 0]ᵀ P [I 0] + He(s_1 [A B]ᵀ Q [I 0]) + s_2 [I 0]ᵀ Q [I 0]
///     - [C D]ᵀ [C D] + b [0 I]ᵀ [0 I] <= 0
std::optional<double> exact_index(const FaultTransfer& transfer, const BandForm& form) {
  const Eigen::Index n = transfer.A.rows();
  const Eigen::Index f = transfer.B.cols();
  MatrixXd next(n, n + f);
  next << transfer.A, transfer.B;
  MatrixXd output(transfer.C.rows(), n + f);
  output << transfer.C, transfer.D;
  const MatrixXd state = MatrixXd::Identity(n, n + f);
  MatrixXd faults = MatrixXd::Zero(n + f, n + f);
  faults.bottomRightCorner(f, f).setIdentity();

  LmiProblem problem;
  const auto variable = [&] {
    return form.is_complex() ? problem.hermitian(n) : problem.symmetric(n);
  };
  const AffineMatrix b = problem.scalar();
  const AffineMatrix P = variable();
  AffineMatrix E = state.transpose() * P * state - next.transpose() * P * next +
                   multiple_of(faults, b) - AffineMatrix(output.transpose() * output);
  if (!form.is_full()) {
    const AffineMatrix Q = variable();
    problem.require_positive("band multiplier", Q);
    E += hermitian_part_twice(form.s_1 * (next.transpose() * Q * state)) +
         form.s_2 * (state.transpose() * Q * state);
  }
  problem.require_negative("generalised KYP", E);
  problem.require_negative("largest index",
                           b - AffineMatrix(MatrixXd::Constant(1, 1, kLargestIndex)));
  problem.minimise(-b);
  const LmiSolution solution = solve(problem, {.strictness = kStrictness});
  if (!solution.is_solved()) return std::nullopt;
  return std::max(0.0, solution.value(b)(0, 0));
}

}  // namespace

std::vector<std::optional<double>> h_minus_indices(const ObserverModel& model,
                                                   const DecouplingMatrices& decoupling,
                                                   const ObserverOutput& output,
                                                   const MatrixXd& gain, const MatrixXd& weight,
                                                   const FrequencyBand& band) {
  const BandForm form = band_form(band);
  std::vector<std::optional<double>> indices;
  for (FaultTransfer transfer : fault_transfers(model, decoupling, output, gain, weight)) {
    const double on_grid = transfer.smallest_on_grid(band, kScalingPoints);
    if (on_grid == 0.0) {
      indices.emplace_back(0.0);  // never above the grid's
      continue;
    }
    transfer.C /= on_grid;
    transfer.D /= on_grid;
    const std::optional<double> squared = exact_index(transfer, form);
    indices.push_back(squared ? std::optional(on_grid * std::sqrt(*squared)) : std::nullopt);
  }
  return indices;
}

std::vector<double> h_minus_on_grid(const ObserverModel& model,
                                    const DecouplingMatrices& decoupling,
                                    const ObserverOutput& output, const MatrixXd& gain,
                                    const MatrixXd& weight, const FrequencyBand& band, int points) {
  std::vector<double> smallest;
  for (const FaultTransfer& transfer : fault_transfers(model, decoupling, output, gain, weight)) {
    smallest.push_back(transfer.smallest_on_grid(band, points));
  }
  return smallest;
}

}  // namespace faultline

#include "diagnosis/design/eigenstructure/compromise.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <fmt/format.h>

#include "diagnosis/design/eigenstructure/unknown_input_response.h"
#include "diagnosis/design/joined_matrices.h"
#include "diagnosis/design/lmi/lmi_problem.h"
#include "diagnosis/design/subspace.h"
#include "diagnosis/model/riccati.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Complex = std::complex<double>;

// Directions that unknown inputs do not reach get this part of the spread of the others: the
// program's numbers stay finite, and a perfect direction still wins by six digits.
constexpr double kSmallestSpread = 1e-6;
// Frequencies the first program is told of, and programs until the worst ones are all known.
constexpr std::size_t kFirstFrequencies = 8;
constexpr int kPrograms = 12;
// A frequency that exceeds the bound by less than that tells nothing new.
constexpr double kKnown = 1.001;
// Rows of less weight than this part of the heaviest are rounding errors of the solver.
constexpr double kLightRow = 1e-7;
// ρ of trade_off_gains(): a dozen over three decades.
constexpr int kTradeOffs = 12;
constexpr double kFastest = 1e-3;
constexpr double kSlowest = 1.0;

MatrixXd inverse_root(const MatrixXd& X) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(X);
  const double largest = std::max(solver.eigenvalues().maxCoeff(), 0.0);
  const double least = largest > 0.0 ? kSmallestSpread * kSmallestSpread * largest : 1.0;
  return solver.eigenvectors() *
         solver.eigenvalues().cwiseMax(least).cwiseSqrt().cwiseInverse().asDiagonal() *
         solver.eigenvectors().transpose();
}

MatrixXd root(const MatrixXd& Phi) {  // rows: √λ_i v_iᵀ, heavy ones first
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(Phi);
  const double heaviest = solver.eigenvalues().maxCoeff();
  MatrixXd rows(0, Phi.cols());
  for (Index i = Phi.rows(); i-- > 0;) {
    if (const double weight = solver.eigenvalues()[i]; weight > kLightRow * heaviest) {
      rows.conservativeResize(rows.rows() + 1, Eigen::NoChange);
      rows.row(rows.rows() - 1) = std::sqrt(weight) * solver.eigenvectors().col(i).transpose();
    }
  }
  return rows;
}

double smallest_wanted_gain(const MatrixXd& Theta, const UnknownInputResponse& response) {
  const MatrixXcd seen = Theta.cast<Complex>() * response.wanted();
  return seen.cols() == 0 ? 0.0 : seen.colwise().norm().minCoeff();
}

// Sᴴ Φ S with Φ a symmetric variable, S p×l complex: entries Σ conj(S_ai) S_bj Φ_ab.
AffineMatrix congruent(const AffineMatrix& Phi, const MatrixXcd& S) {
  std::vector<AffineMatrix::Term> terms;
  for (const AffineMatrix::Term& term : Phi.terms()) {
    for (Index i = 0; i < S.cols(); ++i) {
      for (Index j = 0; j < S.cols(); ++j) {
        terms.push_back(
            {term.variable, i, j, term.value * std::conj(S(term.row, i)) * S(term.col, j)});
      }
    }
  }
  return {S.cols(), S.cols(), std::move(terms)};
}

// One Θ by a semidefinite program in the subspace of V.
class GainProgram {
 public:
  GainProgram(const CompromiseTask& task, const MatrixXd& D_1, CompromiseCriterion criterion)
      : response_(task, D_1), criterion_(criterion) {
    spread_ = criterion == CompromiseCriterion::kRms ? response_.covariance() : mean_spread();
  }

  [[nodiscard]] const UnknownInputResponse& response() const { return response_; }
  [[nodiscard]] bool is_finite() const { return spread_.allFinite(); }
  [[nodiscard]] const MatrixXd& spread() const { return spread_; }

  [[nodiscard]] double ratio(const MatrixXd& Theta) const {
    const double wanted = smallest_wanted_gain(Theta, response_);
    if (!(wanted > 0.0) || !is_finite()) {
      return std::numeric_limits<double>::infinity();
    }
    const double gain = criterion_ == CompromiseCriterion::kRms
                            ? std::sqrt((Theta * spread_ * Theta.transpose()).trace())
                            : response_.peak(Theta).gain;
    return gain / wanted;
  }

  // V: q×p, independent columns.
  [[nodiscard]] Compromise solve_within(const MatrixXd& V) const {
    Compromise result;
    const MatrixXd scaled = V * inverse_root(V.transpose() * spread_ * V);
    const MatrixXcd wanted = scaled.transpose().cast<Complex>() * response_.wanted();
    const double unit = wanted.colwise().norm().minCoeff();
    if (!(unit > 0.0)) {
      result.reason = "these rows do not see a fault that is wanted";
      return result;
    }
    if (scaled.cols() == 1) {  // nothing is left to be weighed
      result.Theta = scaled.transpose();
      result.ratio = ratio(result.Theta);
      result.is_possible = true;
      return result;
    }
    return criterion_ == CompromiseCriterion::kRms ? solve_rms(scaled, wanted / unit)
                                                   : solve_worst_case(scaled, wanted / unit);
  }

 private:
  [[nodiscard]] MatrixXd mean_spread() const {
    const Index q = response_.wanted().rows();
    MatrixXd spread = MatrixXd::Zero(q, q);
    for (const MatrixXcd& T : response_.on_grid()) {
      spread += (T * T.adjoint()).real();
    }
    return spread / static_cast<double>(response_.on_grid().size());
  }

  static void require_faults(LmiProblem& problem, const AffineMatrix& Phi,
                             const MatrixXcd& wanted) {
    for (Index j = 0; j < wanted.cols(); ++j) {
      problem.require_positive(fmt::format("fault {}", j),
                               congruent(Phi, wanted.col(j)) - AffineMatrix(MatrixXd::Ones(1, 1)));
    }
  }

  [[nodiscard]] Compromise finish(const MatrixXd& scaled, const MatrixXd& Phi) const {
    Compromise result;
    result.Theta = root(Phi) * scaled.transpose();
    result.ratio = ratio(result.Theta);
    result.is_possible = std::isfinite(result.ratio);
    if (!result.is_possible) {
      result.reason = "the program's solution does not see a fault that is wanted";
    }
    return result;
  }

  [[nodiscard]] Compromise solve_rms(const MatrixXd& scaled, const MatrixXcd& wanted) const {
    LmiProblem problem;
    const AffineMatrix Phi = problem.symmetric(scaled.cols());
    problem.require_positive("weight", Phi);
    require_faults(problem, Phi, wanted);
    const MatrixXd X = scaled.transpose() * spread_ * scaled;
    std::vector<AffineMatrix::Term> trace;
    for (const AffineMatrix::Term& term : Phi.terms()) {
      trace.push_back({term.variable, 0, 0, term.value * X(term.row, term.col)});
    }
    problem.minimise(AffineMatrix(1, 1, std::move(trace)));
    const LmiSolution solution = solve(problem);
    if (!solution.is_solved()) {
      Compromise result;
      result.reason = solution.reason;
      return result;
    }
    return finish(scaled, solution.value(Phi));
  }

  [[nodiscard]] Compromise solve_worst_case(const MatrixXd& scaled, const MatrixXcd& wanted) const {
    const MatrixXcd V = scaled.transpose().cast<Complex>();
    std::vector<MatrixXcd> known;
    const std::vector<MatrixXcd>& grid = response_.on_grid();
    const std::size_t stride = std::max<std::size_t>(1, grid.size() / kFirstFrequencies);
    for (std::size_t i = 0; i < grid.size(); i += stride) {
      known.push_back(V * grid[i]);
    }
    known.push_back(V * response_.at(response_.peak(scaled.transpose()).lambda));
    Compromise best;
    best.reason = "the program was not solved";
    for (int turn = 0; turn < kPrograms; ++turn) {
      LmiProblem problem;
      const AffineMatrix Phi = problem.symmetric(scaled.cols());
      const AffineMatrix gamma = problem.scalar();
      problem.require_positive("weight", Phi);
      require_faults(problem, Phi, wanted);
      for (const MatrixXcd& S : known) {
        problem.require_negative(
            "gain", congruent(Phi, S) - multiple_of(MatrixXd::Identity(S.cols(), S.cols()), gamma));
      }
      problem.minimise(gamma);
      const LmiSolution solution = solve(problem);
      if (!solution.is_solved()) {
        if (!best.is_possible) {
          best.reason = solution.reason;
        }
        return best;
      }
      const Compromise found = finish(scaled, solution.value(Phi));
      if (found.is_possible && (!best.is_possible || found.ratio < best.ratio)) {
        best = found;
      }
      const UnknownInputResponse::Peak worst = response_.peak(found.Theta);
      if (worst.gain <= kKnown * std::sqrt(std::max(solution.objective, 0.0))) {
        return best;
      }
      known.push_back(V * response_.at(worst.lambda));
    }
    return best;
  }

  UnknownInputResponse response_;
  CompromiseCriterion criterion_;
  MatrixXd spread_;
};

// Directions of Π in which the faults show, the plainest first: Π^½ U, U the left singular vectors
// of Π^½ [T_1 .. T_k].
MatrixXd telling_directions(const MatrixXd& Theta, const MatrixXcd& wanted) {
  const MatrixXcd seen = Theta.cast<Complex>() * wanted;
  MatrixXd both(seen.rows(), 2 * seen.cols());
  both << seen.real(), seen.imag();
  for (Index j = 0; j < seen.cols(); ++j) {  // each fault counts alike
    const double size = data_scale(both.col(j)) + both.col(seen.cols() + j).norm();
    both.col(j) /= size;
    both.col(seen.cols() + j) /= size;
  }
  const Eigen::JacobiSVD<MatrixXd> svd(both, Eigen::ComputeFullU);
  return Theta.transpose() * svd.matrixU();
}

MatrixXd with_column(const MatrixXd& V, const VectorXd& column) {
  return V.cols() == 0 ? MatrixXd(column) : side_by_side(V, column);
}

void keep_better(Compromise& best, const Compromise& other) {
  if (other.is_possible && (!best.is_possible || other.ratio < best.ratio)) {
    best = other;
  }
}

}  // namespace

UnknownInputSpread unknown_input_spread(const CompromiseTask& task) {
  const MatrixXd reached = side_by_side(task.unknown.output, task.M * task.unknown.state);
  const Eigen::JacobiSVD<MatrixXd> svd(reached, Eigen::ComputeFullU);
  const Index q = task.M.rows();
  UnknownInputSpread spread{VectorXd::Zero(q), svd.matrixU().rowwise().reverse()};
  const VectorXd& values = svd.singularValues();
  spread.singular_values.tail(values.size()) = values.reverse();
  return spread;
}

MatrixXd low_rank_rows(const CompromiseTask& task, Index rows) {
  return unknown_input_spread(task).U.leftCols(std::min(rows, task.M.rows())).transpose();
}

MatrixXd static_rows(const CompromiseTask& task, Index rows) {
  SubspaceArithmetic arithmetic;
  const MatrixXd Q = arithmetic.image(task.M.transpose(), data_scale(task.M));
  const Eigen::JacobiSVD<MatrixXd> svd(Q.transpose() * task.unknown.state, Eigen::ComputeFullU);
  const MatrixXd U = svd.matrixU().rowwise().reverse();
  const MatrixXd H = U.leftCols(std::min(rows, U.cols())).transpose() * Q.transpose();
  return H * arithmetic.pseudo_inverse(task.M, data_scale(task.M));
}

double compromise_ratio(const CompromiseTask& task, const MatrixXd& D_1, const MatrixXd& Theta,
                        CompromiseCriterion criterion) {
  return GainProgram(task, D_1, criterion).ratio(Theta);
}

std::vector<Compromise> compromises_by_gain(const CompromiseTask& task, const MatrixXd& D_1,
                                            CompromiseCriterion criterion) {
  assert(task.wanted.state.cols() > 0);
  const Index q = task.M.rows();
  const GainProgram program(task, D_1, criterion);
  std::vector<Compromise> results(static_cast<std::size_t>(q));
  if (!program.is_finite()) {
    for (Compromise& result : results) {
      result.reason =
          "white unknown inputs that reach an output directly have no finite rms in continuous "
          "time: expected domain = \"sampled\" or criterion = \"worst_case\"";
    }
    return results;
  }
  const Compromise full = program.solve_within(MatrixXd::Identity(q, q));
  if (!full.is_possible) {
    std::fill(results.begin(), results.end(), full);
    return results;
  }
  const MatrixXcd& wanted = program.response().wanted();
  const MatrixXd directions = telling_directions(full.Theta, wanted);
  // One row: the best direction for each fault by itself, w = X⁻¹ T_j, may suit all.
  const MatrixXd whiten = inverse_root(program.spread());
  MatrixXd chosen = directions.leftCols(1);
  for (Index j = 0; j < wanted.cols(); ++j) {
    const VectorXd w = whiten * whiten * wanted.col(j).real();
    if (program.ratio(w.transpose()) < program.ratio(chosen.transpose())) {
      chosen = w;
    }
  }
  results[0] = program.solve_within(chosen);
  for (Index p = 2; p < q; ++p) {
    Compromise& best = results[static_cast<std::size_t>(p - 1)];
    best = results[static_cast<std::size_t>(p - 2)];  // fewer rows are allowed, too
    MatrixXd V = directions.leftCols(std::min(p, directions.cols()));
    keep_better(best, program.solve_within(V));
    for (Index i = 0; i < directions.cols(); ++i) {
      const MatrixXd more = with_column(chosen, directions.col(i));
      SubspaceArithmetic arithmetic;
      if (arithmetic.image(unit_columns(more), 1.0).cols() < more.cols()) {
        continue;
      }
      const Compromise found = program.solve_within(more);
      if (found.is_possible && found.ratio < best.ratio) {
        best = found;
        V = more;
      }
    }
    chosen = V;
  }
  if (q > 1) {
    results.back() = full;
    keep_better(results.back(), results[static_cast<std::size_t>(q - 2)]);
  }
  return results;
}

std::vector<MatrixXd> trade_off_gains(const CompromiseTask& task, double decay) {
  const Index d = task.A_0.rows();
  const Index q = task.M.rows();
  std::vector<MatrixXd> gains;
  if (d == 0) {
    return gains;
  }
  const MatrixXd& b = task.unknown.state;
  const MatrixXd& h = task.unknown.output;
  const MatrixXd I = MatrixXd::Identity(d, d);
  const double b_size = data_scale(b);
  const double unit = data_scale(task.M) * b_size / (task.is_sampled ? 1.0 : decay);
  for (int i = 0; i < kTradeOffs; ++i) {
    const double rho =
        unit * kFastest * std::pow(kSlowest / kFastest, static_cast<double>(i) / (kTradeOffs - 1));
    // e' = A_0 e - b d, y = M e - h d + v: correlated through d, which the shift to
    // A_0 - b hᵀ R⁻¹ M takes out.
    const MatrixXd R = h * h.transpose() + rho * rho * MatrixXd::Identity(q, q);
    const MatrixXd S_R = b * h.transpose() * R.ldlt().solve(MatrixXd::Identity(q, q));
    // Modes that d does not reach must be in it, or they keep the plant's own rates.
    const MatrixXd Q =
        b * b.transpose() - S_R * h * b.transpose() + std::pow(kSmallestSpread * b_size, 2) * I;
    const MatrixXd A = task.A_0 - S_R * task.M;
    try {
      if (task.is_sampled) {
        gains.push_back(-S_R - decay * lqr_gain((A / decay).transpose(), task.M.transpose(),
                                                Q / (decay * decay), R)
                                           .transpose());
      } else {
        const MatrixXd Y = solve_care((A + decay * I).transpose(), task.M.transpose(), Q, R);
        gains.push_back(-S_R - Y * task.M.transpose() * R.ldlt().solve(MatrixXd::Identity(q, q)));
      }
    } catch (const std::invalid_argument&) {
      continue;  // this ρ has no filter in double precision; others have
    }
  }
  return gains;
}

}  // namespace faultline

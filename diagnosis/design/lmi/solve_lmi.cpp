#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Eigenvalues>
#include <fmt/core.h>

#include "diagnosis/design/lmi/lmi_problem.h"
#include "diagnosis/design/lmi/scaled_program.h"

namespace faultline {
namespace {

/// How far an eigenvalue must be from zero to have a sign, relative to n times the block's largest
/// entry: some ulps, by which Eigen's symmetric solver may be off.
constexpr double kRounding = 4.0 * std::numeric_limits<double>::epsilon();
/// Size of the scaled variables up to which infeasibility must be proved: those of solutions are
/// of 1 .. 1e4.
constexpr double kProvedRadius = 1e6;
/// Further attempts: with more strictness if x violates the inequalities, with a larger objective
/// if the gap is wide.
constexpr int kRetries = 2;
constexpr double kLargestMagnification = 1e6;
/// Gaps below this are the solver's accuracy (objtol), however small the objective itself.
constexpr double kSolverGap = 1e-7;
/// A ray, scaled so that the objective falls by one along it, may violate the inequalities by this
/// at most per size of the ray.
constexpr double kRayError = 1e-7;

double smallest_eigenvalue(const Eigen::MatrixXd& symmetric) {
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(symmetric, Eigen::EigenvaluesOnly)
      .eigenvalues()[0];
}

struct BlockCheck {
  bool is_positive = true;
  double smallest = std::numeric_limits<double>::infinity();
  std::size_t worst = 0;  // by eigenvalue beside the rounding in its block
};

/// Are all blocks positive definite, by more than rounding?
BlockCheck check_positive(const std::vector<Eigen::MatrixXd>& blocks) {
  BlockCheck check;
  double least_ratio = std::numeric_limits<double>::infinity();
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const double size = blocks[b].cwiseAbs().maxCoeff();
    if (!std::isfinite(size)) return {false, -size, b};
    const double rounding = kRounding * static_cast<double>(blocks[b].rows()) * size;
    const double smallest = smallest_eigenvalue(blocks[b]);
    if (!(smallest > rounding)) check.is_positive = false;
    const double ratio = smallest / std::max(rounding, std::numeric_limits<double>::min());
    if (ratio < least_ratio) {
      least_ratio = ratio;
      check.smallest = smallest;
      check.worst = b;
    }
  }
  return check;
}

/// The radius up to which X proves that there is no solution: with X ⪰ 0 every feasible x has
/// 0 <= tr(X Z(x)) = Σ x_k tr(A_k X) - tr(C X), hence max |x_k| >= tr(C X) / Σ |tr(A_k X)|. What
/// X lacks to be positive semidefinite is added to its diagonal first.
double infeasible_radius(const SemidefiniteProgram& program, std::vector<Eigen::MatrixXd> X) {
  for (std::size_t b = 0; b < program.block_sizes.size(); ++b) {
    const double size = X[b].cwiseAbs().maxCoeff();
    if (!std::isfinite(size)) return 0.0;
    const double rounding = kRounding * static_cast<double>(X[b].rows()) * size;
    X[b].diagonal().array() += std::max(0.0, rounding - smallest_eigenvalue(X[b]));
  }
  double constant = 0.0;
  Eigen::VectorXd slopes = Eigen::VectorXd::Zero(program.c.size());
  for (const SemidefiniteProgram::Entry& entry : program.entries) {
    const Eigen::MatrixXd& block = X[static_cast<std::size_t>(entry.block)];
    const double product =
        (entry.row == entry.col ? 1.0 : 2.0) * entry.value * block(entry.row, entry.col);
    (entry.variable < 0 ? constant : slopes[entry.variable]) += product;
  }
  if (!(constant > 0.0)) return 0.0;
  return constant / std::max(slopes.cwiseAbs().sum(), std::numeric_limits<double>::min());
}

/// Judges what the solver says of one problem.
class Judge {
 public:
  Judge(const LmiProblem& problem, const LmiOptions& options)
      : problem_(problem), options_(options), scaled_(problem, options) {}

  [[nodiscard]] SolverAnswer ask() const {
    return faultline::solve(scaled_.program(), options_.residual);
  }

  /// The solver proved nothing, and its x violates the inequalities.
  [[nodiscard]] bool is_violated(const SolverAnswer& answer) const {
    return is_point(answer) &&
           !(answer.x.allFinite() && check_positive(scaled_.slacks(answer.x, false)).is_positive);
  }

  /// By what the objective should be multiplied for the solver to see its gap: it stops when that
  /// is small beside 1 + objective, and this objective is small beside one. Else 1.
  [[nodiscard]] double magnification(const SolverAnswer& answer) const {
    if (!is_point(answer)) return 1.0;
    const auto [gap, largest] = gap_of(answer);
    if (!(gap > options_.largest_gap * largest) || largest >= 1.0) return 1.0;
    return std::min(1.0 / largest, kLargestMagnification);
  }

  LmiSolution judge(const SolverAnswer& answer) {
    switch (answer.outcome) {
      case SolverOutcome::kTooLarge:
        return inaccurate(fmt::format(
            "{} variables are more than the {} that are tried: fewer states, or a scalar weight",
            scaled_.program().c.size(), kLargestProgram));
      case SolverOutcome::kInfeasible:
        if (infeasible_radius(scaled_.program(), answer.X) >= kProvedRadius) return infeasible();
        return by_feasibility(answer);
      case SolverOutcome::kUnbounded:
        return by_feasibility(answer);
      default:
        return by_point(answer);
    }
  }

 private:
  static bool is_point(const SolverAnswer& answer) {
    return answer.outcome == SolverOutcome::kOptimal ||
           answer.outcome == SolverOutcome::kReducedAccuracy ||
           answer.outcome == SolverOutcome::kStuck;
  }

  struct Gap {
    double gap, largest;
  };
  /// Between objective and bound, and the larger of them; as the solver sees them.
  [[nodiscard]] Gap gap_of(const SolverAnswer& answer) const {
    const double objective = scaled_.program().c.dot(answer.x);
    return {std::abs(objective - answer.dual_objective),
            std::max(std::abs(objective), std::abs(answer.dual_objective))};
  }

  LmiSolution by_point(const SolverAnswer& answer) {
    LmiSolution solution;
    const BlockCheck check = answer.x.allFinite() ? check_positive(scaled_.slacks(answer.x, false))
                                                  : BlockCheck{false, NAN, 0};
    if (!check.is_positive) return by_feasibility(answer);
    if (scaled_.has_free_cost()) return unbounded();
    const auto [gap, largest] = gap_of(answer);
    if (!(gap <= std::max(options_.largest_gap * largest, kSolverGap))) {
      return inaccurate(fmt::format(
          "the solver stopped (code {}) at a point that satisfies all inequalities but is known to "
          "be within {:.2g} % of the optimum only: fewer states, or variables in units in which "
          "they are of similar size",
          answer.code, 100.0 * gap / largest));
    }
    solution.status = LmiStatus::kSolved;
    solution.x = scaled_.unscaled(answer.x);
    solution.objective = scaled_.unscaled_objective(scaled_.program().c.dot(answer.x));
    solution.bound = scaled_.unscaled_objective(answer.dual_objective);
    solution.largest_eigenvalue = -check.smallest;
    return solution;
  }

  /// The solver found no solution: is there a feasible point at all?
  LmiSolution by_feasibility(const SolverAnswer& first) {
    const SemidefiniteProgram program = scaled_.feasibility_program();
    const SolverAnswer answer = faultline::solve(program, options_.residual);
    if (answer.outcome == SolverOutcome::kTooLarge || !answer.x.allFinite())
      return undecided(first);
    const auto k = scaled_.program().c.size();
    const BlockCheck check = check_positive(scaled_.slacks(answer.x.head(k), false));
    if (check.is_positive) {
      return first.outcome == SolverOutcome::kUnbounded && is_ray(first.x) ? unbounded()
                                                                           : undecided(first);
    }
    if (infeasible_radius(scaled_.program(), answer.X) >= kProvedRadius) return infeasible();
    return undecided(first);
  }

  bool is_ray(const Eigen::VectorXd& x) const {
    const double fall = -scaled_.program().c.dot(x);
    if (!(fall > 0.0)) return false;
    const Eigen::VectorXd ray = x / fall;
    double smallest = 0.0;
    for (const Eigen::MatrixXd& block : scaled_.slacks(ray, true)) {
      smallest = std::min(smallest, smallest_eigenvalue(block));
    }
    return smallest >= -kRayError * std::max(1.0, ray.cwiseAbs().maxCoeff());
  }

  LmiSolution infeasible() const {
    LmiSolution solution;
    solution.status = LmiStatus::kInfeasible;
    solution.reason = "the inequalities contradict each other: the solver's proof was checked";
    return solution;
  }

  static LmiSolution unbounded() {
    LmiSolution solution;
    solution.status = LmiStatus::kUnbounded;
    solution.reason = "the objective can be made as small as one likes: a bound is missing";
    return solution;
  }

  LmiSolution undecided(const SolverAnswer& answer) const {
    std::string found = "no point that satisfies them";
    if (answer.x.allFinite()) {
      const BlockCheck check = check_positive(scaled_.slacks(answer.x, false));
      found = fmt::format("a point at which '{}' has the eigenvalue {:.2g} (scaled; < 0 expected)",
                          problem_.inequalities()[check.worst].name, -check.smallest);
    }
    return inaccurate(fmt::format(
        "the solver (code {}) found {}, and no proof that there is none: the inequalities are "
        "nearly contradictory, or too badly scaled for double precision; fewer states, or states "
        "in units in which they are of similar size",
        answer.code, found));
  }

  static LmiSolution inaccurate(std::string reason) {
    LmiSolution solution;
    solution.reason = std::move(reason);
    return solution;
  }

  const LmiProblem& problem_;
  const LmiOptions& options_;
  const ScaledProgram scaled_;
};

}  // namespace

LmiSolution solve(const LmiProblem& problem, const LmiOptions& options) {
  LmiOptions next = options;
  for (int retry = 0;; ++retry) {
    Judge judge(problem, next);
    const SolverAnswer answer = judge.ask();
    if (retry == kRetries) return judge.judge(answer);
    if (judge.is_violated(answer)) {
      next.strictness *= 10.0;
      next.residual *= 10.0;
    } else if (const double factor = judge.magnification(answer); factor > 1.0) {
      next.objective_factor *= factor;
    } else {
      return judge.judge(answer);
    }
  }
}

}  // namespace faultline

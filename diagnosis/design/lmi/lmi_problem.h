#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/lmi/affine_matrix.h"

namespace faultline {

/// Minimise an affine objective subject to linear matrix inequalities:
///
///   min f(x)   subject to   E_b(x) < 0 for every b,   E_b affine and Hermitian
class LmiProblem {
 public:
  struct Inequality {
    std::string name;  ///< for messages
    AffineMatrix E;
  };

  /// New variables, as matrices of the shape.
  [[nodiscard]] AffineMatrix symmetric(Eigen::Index n);                   ///< n(n+1)/2 of them
  [[nodiscard]] AffineMatrix hermitian(Eigen::Index n);                   ///< n²
  [[nodiscard]] AffineMatrix full(Eigen::Index rows, Eigen::Index cols);  ///< rows·cols
  [[nodiscard]] AffineMatrix scalar() { return full(1, 1); }

  /// E < 0. @pre E is Hermitian for every x; its blocks may be empty
  void require_negative(std::string name, const AffineMatrix& E);
  /// E > 0.
  void require_positive(std::string name, const AffineMatrix& E);
  /// f: a real 1×1 affine matrix; zero if never called: any point will do.
  void minimise(const AffineMatrix& objective);

  [[nodiscard]] Eigen::Index variable_count() const { return variable_count_; }
  [[nodiscard]] const std::vector<Inequality>& inequalities() const { return inequalities_; }
  [[nodiscard]] const AffineMatrix& objective() const { return objective_; }

 private:
  Eigen::Index variable_count_ = 0;
  std::vector<Inequality> inequalities_;
  AffineMatrix objective_{1, 1};
};

enum class LmiStatus {
  kSolved,      ///< x satisfies every inequality, checked, and is close to the optimum
  kInfeasible,  ///< no x does (of reasonable size: see LmiSolution::reason)
  kUnbounded,   ///< an x does, and the objective can be made as small as one likes
  kInaccurate,  ///< could not be decided in double precision, or is too large
};

struct LmiOptions {
  /// E_b <= -strictness·I is asked of the solver, in coordinates in which the largest entries of
  /// every row are about one. Must make up for the residual; changes optima behind their fourth
  /// digit.
  double strictness = 1e-8;
  /// What the solver may leave of its equations, relative to the data; less than 1e-9 is often more
  /// than it can do. Where x violates the inequalities for it, both are raised tenfold, twice.
  double residual = 1e-9;
  /// |f - lower bound| / max(|f|, |bound|) at most of a solution. A wider gap costs optimality, not
  /// validity: what is returned satisfies the inequalities.
  double largest_gap = 1e-2;
  /// The solver's own tolerances are relative to 1 + objective; it sees this times it, after c is
  /// scaled to ones. Raised where the objective turns out to be small.
  double objective_factor = 1.0;
  /// False: the data as they are. For measuring what scaling is worth.
  bool scales = true;
};

struct LmiSolution {
  LmiStatus status = LmiStatus::kInaccurate;
  std::string reason;  ///< unless solved: in words
  Eigen::VectorXd x;   ///< if solved
  double objective = 0.0;
  double bound = 0.0;               ///< no x has a smaller objective, by the solver's dual
  double largest_eigenvalue = 0.0;  ///< of all E_b(x), in the scaled coordinates; < 0 if solved

  [[nodiscard]] bool is_solved() const { return status == LmiStatus::kSolved; }
  /// The value of a real affine matrix at the solution. @pre is_solved()
  [[nodiscard]] Eigen::MatrixXd value(const AffineMatrix& a) const { return a.at(x).real(); }
};

/// Complex blocks become real ones, E <= 0 ⟺ [Re E, -Im E; Im E, Re E] <= 0. Variables and rows
/// are scaled by powers of two, so that the solver sees data of about one. What it returns is
/// believed only as far as it was checked:
/// - solved: all E_b(x) have only eigenvalues below zero, by more than rounding;
/// - infeasible: with the solver's X ⪰ 0, Σ tr(X E_b(x)) > 0 for every x with |x_k| up to 1e6 in
///   scaled coordinates;
/// - unbounded: a feasible point exists (a second program finds one) and along the solver's ray the
///   objective falls while no inequality gets worse.
/// Deterministic; may be called from any thread. Cost: m³ per iteration for m variables.
/// @throws std::invalid_argument if a number of the data is not finite, or there is no variable
[[nodiscard]] LmiSolution solve(const LmiProblem& problem, const LmiOptions& options = {});

}  // namespace faultline

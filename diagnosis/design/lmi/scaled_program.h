#pragma once

#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/lmi/lmi_problem.h"
#include "diagnosis/design/lmi/semidefinite_program.h"

namespace faultline {

/// An LMI problem as the solver gets it: real, in scaled coordinates, without the variables that
/// enter no inequality. With D_b, s, γ of powers of two (scaling loses no digit)
///
///   x_k = s_k x'_k,   minimise γ cᵀx   s.t.   -D_b E_b(x) D_b - strictness·I ⪰ 0
class ScaledProgram {
 public:
  ScaledProgram(const LmiProblem& problem, const LmiOptions& options);

  [[nodiscard]] const SemidefiniteProgram& program() const { return program_; }
  /// The same inequalities with t I on their right-hand sides, t >= -1 minimised: a feasible point
  /// exists iff the minimum is negative. t is the last variable, its bound the last block.
  [[nodiscard]] SemidefiniteProgram feasibility_program() const;

  /// A variable that enters no inequality and yet the objective: the problem is unbounded if it is
  /// feasible.
  [[nodiscard]] bool has_free_cost() const { return has_free_cost_; }
  /// All variables, unscaled, from the solver's (or from its first ones).
  [[nodiscard]] Eigen::VectorXd unscaled(const Eigen::VectorXd& x) const;
  /// cᵀx, unscaled, of the solver's value of the objective.
  [[nodiscard]] double unscaled_objective(double objective) const;
  /// -D_b E_b D_b (without the strictness) at the solver's x; without E_0 if `is_direction`.
  [[nodiscard]] std::vector<Eigen::MatrixXd> slacks(const Eigen::VectorXd& x,
                                                    bool is_direction) const;

 private:
  using Entry = SemidefiniteProgram::Entry;

  void add_block(const AffineMatrix& E);
  void equilibrate();
  void add_objective(const AffineMatrix& objective, double factor);
  void take_solvers_form();

  double strictness_ = 0.0;
  Eigen::VectorXd variable_scale_;          // s, of all variables
  std::vector<Eigen::VectorXd> row_scale_;  // D_b
  std::vector<Eigen::Index> kept_;          // the solver's variables
  double objective_scale_ = 1.0;            // γ
  double objective_constant_ = 0.0;
  bool has_free_cost_ = false;
  SemidefiniteProgram program_;
};

}  // namespace faultline

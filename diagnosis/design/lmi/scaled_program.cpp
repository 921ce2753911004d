#include "diagnosis/design/lmi/scaled_program.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace faultline {
namespace {

/// Sweeps over rows and variables. Ruiz's iteration (RAL-TR-2001-034) halves the distance to ones
/// with each; after eight the largest entries are within a few per cent.
constexpr int kScalingSweeps = 8;

double power_of_two(double scale) { return std::exp2(std::round(std::log2(scale))); }

}  // namespace

ScaledProgram::ScaledProgram(const LmiProblem& problem, const LmiOptions& options)
    : strictness_(options.strictness),
      variable_scale_(Eigen::VectorXd::Ones(problem.variable_count())) {
  for (const LmiProblem::Inequality& inequality : problem.inequalities()) {
    for (const AffineMatrix::Term& term : inequality.E.terms()) {
      if (!std::isfinite(term.value.real()) || !std::isfinite(term.value.imag())) {
        throw std::invalid_argument("inequality '" + inequality.name +
                                    "' has a number that is not finite; expected finite ones");
      }
    }
    add_block(inequality.E);
  }
  if (options.scales) equilibrate();
  add_objective(problem.objective(), options.objective_factor);

  take_solvers_form();
}

void ScaledProgram::add_block(const AffineMatrix& E) {
  const bool is_complex = std::any_of(E.terms().begin(), E.terms().end(),
                                      [](const auto& term) { return term.value.imag() != 0.0; });
  const Eigen::Index n = E.rows();
  const auto block = static_cast<Eigen::Index>(program_.block_sizes.size());
  program_.block_sizes.push_back(is_complex ? 2 * n : n);
  row_scale_.emplace_back(Eigen::VectorXd::Ones(program_.block_sizes.back()));
  for (const AffineMatrix::Term& term : E.terms()) {
    const auto add = [&](Eigen::Index row, Eigen::Index col, double value) {
      if (row <= col && value != 0.0) {
        program_.entries.push_back({term.variable, block, row, col, value});
      }
    };
    add(term.row, term.col, term.value.real());
    if (!is_complex) continue;
    add(term.row + n, term.col + n, term.value.real());
    add(term.row, term.col + n, -term.value.imag());
  }
}

void ScaledProgram::equilibrate() {
  for (int sweep = 0; sweep < kScalingSweeps; ++sweep) {
    std::vector<Eigen::VectorXd> row_largest;
    for (const Eigen::VectorXd& D : row_scale_) {
      row_largest.emplace_back(Eigen::VectorXd::Zero(D.size()));
    }
    Eigen::VectorXd variable_largest = Eigen::VectorXd::Zero(variable_scale_.size());
    for (const Entry& entry : program_.entries) {
      const auto block = static_cast<std::size_t>(entry.block);
      double size =
          std::abs(entry.value) * row_scale_[block][entry.row] * row_scale_[block][entry.col];
      if (entry.variable >= 0) {
        size *= variable_scale_[entry.variable];
        double& largest = variable_largest[entry.variable];
        largest = std::max(largest, size);
      }
      for (const Eigen::Index row : {entry.row, entry.col}) {
        row_largest[block][row] = std::max(row_largest[block][row], size);
      }
    }
    for (std::size_t b = 0; b < row_scale_.size(); ++b) {
      for (Eigen::Index i = 0; i < row_scale_[b].size(); ++i) {
        if (row_largest[b][i] > 0.0) row_scale_[b][i] /= std::sqrt(std::sqrt(row_largest[b][i]));
      }
    }
    for (Eigen::Index k = 0; k < variable_scale_.size(); ++k) {
      if (variable_largest[k] > 0.0) variable_scale_[k] /= std::sqrt(variable_largest[k]);
    }
  }
  for (Eigen::VectorXd& D : row_scale_) D = D.unaryExpr(&power_of_two);
  variable_scale_ = variable_scale_.unaryExpr(&power_of_two);
}

void ScaledProgram::add_objective(const AffineMatrix& objective, double factor) {
  std::vector<bool> enters(static_cast<std::size_t>(variable_scale_.size()), false);
  for (const Entry& entry : program_.entries) {
    if (entry.variable >= 0) enters[static_cast<std::size_t>(entry.variable)] = true;
  }
  Eigen::VectorXd c = Eigen::VectorXd::Zero(variable_scale_.size());
  for (const AffineMatrix::Term& term : objective.terms()) {
    if (!std::isfinite(term.value.real())) {
      throw std::invalid_argument("the objective has a number that is not finite");
    }
    if (term.variable < 0) {
      objective_constant_ = term.value.real();
    } else if (enters[static_cast<std::size_t>(term.variable)]) {
      c[term.variable] = term.value.real() * variable_scale_[term.variable];
    } else {
      has_free_cost_ = true;
    }
  }
  const double largest = c.size() > 0 ? c.cwiseAbs().maxCoeff() : 0.0;
  if (largest > 0.0) objective_scale_ = power_of_two(factor / largest);
  for (Eigen::Index k = 0; k < c.size(); ++k) {
    if (enters[static_cast<std::size_t>(k)]) kept_.push_back(k);
  }
  if (kept_.empty()) throw std::invalid_argument("an LMI problem without variables");
  program_.c.resize(static_cast<Eigen::Index>(kept_.size()));
  for (std::size_t k = 0; k < kept_.size(); ++k) {
    program_.c[static_cast<Eigen::Index>(k)] = objective_scale_ * c[kept_[k]];
  }
}

void ScaledProgram::take_solvers_form() {
  std::vector<Eigen::Index> position(static_cast<std::size_t>(variable_scale_.size()), -1);
  for (std::size_t k = 0; k < kept_.size(); ++k) {
    position[static_cast<std::size_t>(kept_[k])] = static_cast<Eigen::Index>(k);
  }
  std::vector<Eigen::VectorXd> strictness;
  for (const Eigen::Index size : program_.block_sizes) {
    strictness.emplace_back(Eigen::VectorXd::Constant(size, strictness_));
  }
  for (Entry& entry : program_.entries) {
    const auto block = static_cast<std::size_t>(entry.block);
    entry.value *= row_scale_[block][entry.row] * row_scale_[block][entry.col];
    if (entry.variable >= 0) {
      entry.value *= -variable_scale_[entry.variable];
      entry.variable = position[static_cast<std::size_t>(entry.variable)];
    } else if (entry.row == entry.col) {
      entry.value += std::exchange(strictness[block][entry.row], 0.0);
    }
  }
  for (std::size_t b = 0; b < strictness.size(); ++b) {
    for (Eigen::Index i = 0; i < strictness[b].size(); ++i) {
      if (strictness[b][i] == 0.0) continue;
      program_.entries.push_back({-1, static_cast<Eigen::Index>(b), i, i, strictness[b][i]});
    }
  }
}

SemidefiniteProgram ScaledProgram::feasibility_program() const {
  SemidefiniteProgram program = program_;
  const Eigen::Index t = program.c.size();
  program.c = Eigen::VectorXd::Unit(t + 1, t);
  for (std::size_t b = 0; b < program_.block_sizes.size(); ++b) {
    for (Eigen::Index i = 0; i < program_.block_sizes[b]; ++i) {
      program.entries.push_back({t, static_cast<Eigen::Index>(b), i, i, 1.0});
    }
  }
  const auto bound = static_cast<Eigen::Index>(program.block_sizes.size());
  program.block_sizes.push_back(1);
  program.entries.push_back({t, bound, 0, 0, 1.0});
  program.entries.push_back({-1, bound, 0, 0, -1.0});
  return program;
}

Eigen::VectorXd ScaledProgram::unscaled(const Eigen::VectorXd& x) const {
  Eigen::VectorXd all = Eigen::VectorXd::Zero(variable_scale_.size());
  for (std::size_t k = 0; k < kept_.size(); ++k) {
    all[kept_[k]] = variable_scale_[kept_[k]] * x[static_cast<Eigen::Index>(k)];
  }
  return all;
}

double ScaledProgram::unscaled_objective(double objective) const {
  return objective / objective_scale_ + objective_constant_;
}

std::vector<Eigen::MatrixXd> ScaledProgram::slacks(const Eigen::VectorXd& x,
                                                   bool is_direction) const {
  std::vector<Eigen::MatrixXd> Z;
  for (const Eigen::Index size : program_.block_sizes) {
    Z.emplace_back(Eigen::MatrixXd::Zero(size, size));
    if (!is_direction) Z.back().diagonal().setConstant(strictness_);
  }
  for (const Entry& entry : program_.entries) {
    if (entry.variable < 0 && is_direction) continue;
    const double factor = entry.variable < 0 ? -1.0 : x[entry.variable];
    Z[static_cast<std::size_t>(entry.block)](entry.row, entry.col) += factor * entry.value;
  }
  for (Eigen::MatrixXd& block : Z) {
    block.triangularView<Eigen::StrictlyLower>() = block.transpose();
  }
  return Z;
}

}  // namespace faultline

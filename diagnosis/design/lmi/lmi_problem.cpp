#include "diagnosis/design/lmi/lmi_problem.h"

#include <cassert>
#include <utility>

namespace faultline {

using Term = AffineMatrix::Term;

AffineMatrix LmiProblem::symmetric(Eigen::Index n) {
  std::vector<Term> terms;
  for (Eigen::Index j = 0; j < n; ++j) {
    for (Eigen::Index i = 0; i <= j; ++i, ++variable_count_) {
      terms.push_back({variable_count_, i, j, 1.0});
      if (i != j) terms.push_back({variable_count_, j, i, 1.0});
    }
  }
  return {n, n, std::move(terms)};
}

AffineMatrix LmiProblem::hermitian(Eigen::Index n) {
  AffineMatrix real = symmetric(n);
  std::vector<Term> imaginary;
  for (Eigen::Index j = 0; j < n; ++j) {
    for (Eigen::Index i = 0; i < j; ++i, ++variable_count_) {
      imaginary.push_back({variable_count_, i, j, {0.0, 1.0}});
      imaginary.push_back({variable_count_, j, i, {0.0, -1.0}});
    }
  }
  return real += AffineMatrix(n, n, std::move(imaginary));
}

AffineMatrix LmiProblem::full(Eigen::Index rows, Eigen::Index cols) {
  std::vector<Term> terms;
  for (Eigen::Index j = 0; j < cols; ++j) {
    for (Eigen::Index i = 0; i < rows; ++i) terms.push_back({variable_count_++, i, j, 1.0});
  }
  return {rows, cols, std::move(terms)};
}

void LmiProblem::require_negative(std::string name, const AffineMatrix& E) {
  assert(E.rows() == E.cols());
  if (E.rows() > 0) inequalities_.push_back({std::move(name), E});
}

void LmiProblem::require_positive(std::string name, const AffineMatrix& E) {
  require_negative(std::move(name), -E);
}

void LmiProblem::minimise(const AffineMatrix& objective) {
  assert(objective.rows() == 1 && objective.cols() == 1);
  objective_ = objective;
}

}  // namespace faultline

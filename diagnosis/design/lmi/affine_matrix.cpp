#include "diagnosis/design/lmi/affine_matrix.h"

#include <algorithm>
#include <cassert>
#include <tuple>
#include <utility>

namespace faultline {

AffineMatrix::AffineMatrix(const Eigen::MatrixXd& constant)
    : rows_(constant.rows()), cols_(constant.cols()) {
  for (Eigen::Index j = 0; j < cols_; ++j) {
    for (Eigen::Index i = 0; i < rows_; ++i) terms_.push_back({kConstant, i, j, constant(i, j)});
  }
  normalise();
}

AffineMatrix::AffineMatrix(Eigen::Index rows, Eigen::Index cols, std::vector<Term> terms)
    : rows_(rows), cols_(cols), terms_(std::move(terms)) {
  normalise();
}

void AffineMatrix::normalise() {
  const auto place = [](const Term& t) { return std::tie(t.variable, t.col, t.row); };
  // Stable: the terms of an entry are added in the order they were written in, on any machine.
  std::stable_sort(terms_.begin(), terms_.end(),
                   [&](const Term& a, const Term& b) { return place(a) < place(b); });
  std::vector<Term> merged;
  merged.reserve(terms_.size());
  for (const Term& term : terms_) {
    if (!merged.empty() && place(merged.back()) == place(term)) {
      merged.back().value += term.value;
    } else {
      merged.push_back(term);
    }
  }
  std::erase_if(merged, [](const Term& t) { return t.value == 0.0; });
  terms_ = std::move(merged);
}

AffineMatrix AffineMatrix::adjoint() const {
  std::vector<Term> terms = terms_;
  for (Term& term : terms) {
    std::swap(term.row, term.col);
    term.value = std::conj(term.value);
  }
  return {cols_, rows_, std::move(terms)};
}

Eigen::MatrixXcd AffineMatrix::at(const Eigen::VectorXd& x) const {
  Eigen::MatrixXcd value = Eigen::MatrixXcd::Zero(rows_, cols_);
  for (const Term& term : terms_) {
    const double factor = term.variable == kConstant ? 1.0 : x[term.variable];
    value(term.row, term.col) += factor * term.value;
  }
  return value;
}

AffineMatrix& AffineMatrix::operator+=(const AffineMatrix& other) {
  assert(rows_ == other.rows_ && cols_ == other.cols_);
  terms_.insert(terms_.end(), other.terms_.begin(), other.terms_.end());
  normalise();
  return *this;
}

AffineMatrix operator*(std::complex<double> factor, const AffineMatrix& a) {
  std::vector<AffineMatrix::Term> terms = a.terms_;
  for (AffineMatrix::Term& term : terms) term.value *= factor;
  return {a.rows_, a.cols_, std::move(terms)};
}

AffineMatrix operator*(const Eigen::MatrixXd& left, const AffineMatrix& right) {
  assert(left.cols() == right.rows());
  std::vector<AffineMatrix::Term> terms;
  for (const AffineMatrix::Term& term : right.terms_) {
    for (Eigen::Index i = 0; i < left.rows(); ++i) {
      const double factor = left(i, term.row);
      if (factor != 0.0) terms.push_back({term.variable, i, term.col, factor * term.value});
    }
  }
  return {left.rows(), right.cols_, std::move(terms)};
}

AffineMatrix operator*(const AffineMatrix& left, const Eigen::MatrixXd& right) {
  assert(left.cols() == right.rows());
  std::vector<AffineMatrix::Term> terms;
  for (const AffineMatrix::Term& term : left.terms_) {
    for (Eigen::Index j = 0; j < right.cols(); ++j) {
      const double factor = right(term.col, j);
      if (factor != 0.0) terms.push_back({term.variable, term.row, j, factor * term.value});
    }
  }
  return {left.rows_, right.cols(), std::move(terms)};
}

AffineMatrix hermitian_part_twice(const AffineMatrix& a) { return a + a.adjoint(); }

AffineMatrix multiple_of(const Eigen::MatrixXd& M, const AffineMatrix& scalar) {
  assert(scalar.rows() == 1 && scalar.cols() == 1);
  std::vector<AffineMatrix::Term> terms;
  for (const AffineMatrix::Term& term : scalar.terms()) {
    for (Eigen::Index j = 0; j < M.cols(); ++j) {
      for (Eigen::Index i = 0; i < M.rows(); ++i) {
        terms.push_back({term.variable, i, j, M(i, j) * term.value});
      }
    }
  }
  return {M.rows(), M.cols(), std::move(terms)};
}

AffineMatrix diagonal(const AffineMatrix& column) {
  assert(column.cols() == 1);
  std::vector<AffineMatrix::Term> terms = column.terms();
  for (AffineMatrix::Term& term : terms) term.col = term.row;
  return {column.rows(), column.rows(), std::move(terms)};
}

AffineMatrix beside(const std::vector<AffineMatrix>& blocks) {
  assert(!blocks.empty());
  std::vector<AffineMatrix::Term> terms;
  Eigen::Index cols = 0;
  for (const AffineMatrix& block : blocks) {
    assert(block.rows() == blocks.front().rows());
    for (AffineMatrix::Term term : block.terms()) {
      term.col += cols;
      terms.push_back(term);
    }
    cols += block.cols();
  }
  return {blocks.front().rows(), cols, std::move(terms)};
}

AffineMatrix hermitian(const std::vector<std::vector<AffineMatrix>>& upper) {
  std::vector<AffineMatrix::Term> terms;
  Eigen::Index row = 0;
  for (std::size_t i = 0; i < upper.size(); ++i) {
    assert(upper[i].size() == upper.size() - i);
    Eigen::Index col = row;
    for (std::size_t j = i; j < upper.size(); ++j) {
      const AffineMatrix& block = upper[i][j - i];
      assert(block.rows() == upper[i][0].rows() && block.cols() == upper[j][0].cols());
      for (AffineMatrix::Term term : block.terms()) {
        term.row += row;
        term.col += col;
        terms.push_back(term);
        if (j == i) continue;
        std::swap(term.row, term.col);
        term.value = std::conj(term.value);
        terms.push_back(term);
      }
      col += block.cols();
    }
    row += upper[i][0].rows();
  }
  return {row, row, std::move(terms)};
}

}  // namespace faultline

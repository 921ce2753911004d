#include "tests/support/exact_arithmetic.h"

#include <cassert>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace faultline {
namespace {

using Eigen::Index;
__extension__ using Wide = unsigned __int128;

constexpr std::uint64_t kPrime = (std::uint64_t{1} << 61) - 1;

std::uint64_t plus(std::uint64_t a, std::uint64_t b) { return (a + b) % kPrime; }
std::uint64_t minus(std::uint64_t a, std::uint64_t b) { return (a + kPrime - b) % kPrime; }
std::uint64_t times(std::uint64_t a, std::uint64_t b) {
  return static_cast<std::uint64_t>(static_cast<Wide>(a) * b % kPrime);
}

// a⁻¹ = a^(prime - 2), Fermat.
std::uint64_t inverse(std::uint64_t a) {
  std::uint64_t result = 1;
  for (std::uint64_t exponent = kPrime - 2; exponent > 0; exponent >>= 1) {
    if ((exponent & 1) != 0) {
      result = times(result, a);
    }
    a = times(a, a);
  }
  return result;
}

void swap_rows(ExactMatrix& X, Index i, Index k) {
  for (Index j = 0; j < X.cols(); ++j) {
    std::swap(X.at(i, j), X.at(k, j));
  }
}

// row i -= factor · row k
void subtract_row(ExactMatrix& X, Index i, Index k, std::uint64_t factor) {
  for (Index j = 0; j < X.cols(); ++j) {
    X.at(i, j) = minus(X.at(i, j), times(factor, X.at(k, j)));
  }
}

// Reduced row echelon form in place; the pivot columns.
std::vector<Index> reduce(ExactMatrix& X) {
  std::vector<Index> pivots;
  for (Index j = 0; j < X.cols() && std::ssize(pivots) < X.rows(); ++j) {
    const Index next = std::ssize(pivots);
    Index i = next;
    while (i < X.rows() && X.at(i, j) == 0) {
      ++i;
    }
    if (i == X.rows()) {
      continue;
    }
    swap_rows(X, i, next);
    const std::uint64_t scale = inverse(X.at(next, j));
    for (Index l = 0; l < X.cols(); ++l) {
      X.at(next, l) = times(scale, X.at(next, l));
    }
    for (Index k = 0; k < X.rows(); ++k) {
      if (k != next && X.at(k, j) != 0) {
        subtract_row(X, k, next, X.at(k, j));
      }
    }
    pivots.push_back(j);
  }
  return pivots;
}

}  // namespace

ExactMatrix::ExactMatrix(Index rows, Index cols)
    : rows_(rows), cols_(cols), values_(static_cast<std::size_t>(rows * cols), 0) {}

ExactMatrix::ExactMatrix(const Eigen::MatrixXd& whole_numbers)
    : ExactMatrix(whole_numbers.rows(), whole_numbers.cols()) {
  for (Index i = 0; i < rows_; ++i) {
    for (Index j = 0; j < cols_; ++j) {
      const double value = whole_numbers(i, j);
      assert(value == std::round(value) && std::abs(value) < std::ldexp(1.0, 53));
      const auto size = static_cast<std::uint64_t>(std::abs(value));
      at(i, j) = value < 0.0 ? minus(0, size) : size;
    }
  }
}

ExactMatrix operator*(const ExactMatrix& X, const ExactMatrix& Y) {
  assert(X.cols() == Y.rows());
  ExactMatrix product(X.rows(), Y.cols());
  for (Index i = 0; i < X.rows(); ++i) {
    for (Index j = 0; j < Y.cols(); ++j) {
      for (Index k = 0; k < X.cols(); ++k) {
        product.at(i, j) = plus(product.at(i, j), times(X.at(i, k), Y.at(k, j)));
      }
    }
  }
  return product;
}

ExactMatrix side_by_side(const ExactMatrix& X, const ExactMatrix& Y) {
  return transpose(stacked(transpose(X), transpose(Y)));
}

ExactMatrix stacked(const ExactMatrix& X, const ExactMatrix& Y) {
  assert(X.cols() == Y.cols());
  ExactMatrix both(X.rows() + Y.rows(), X.cols());
  for (Index i = 0; i < both.rows(); ++i) {
    for (Index j = 0; j < X.cols(); ++j) {
      both.at(i, j) = i < X.rows() ? X.at(i, j) : Y.at(i - X.rows(), j);
    }
  }
  return both;
}

ExactMatrix transpose(const ExactMatrix& X) {
  ExactMatrix result(X.cols(), X.rows());
  for (Index i = 0; i < X.rows(); ++i) {
    for (Index j = 0; j < X.cols(); ++j) {
      result.at(j, i) = X.at(i, j);
    }
  }
  return result;
}

Index rank(const ExactMatrix& X) {
  ExactMatrix reduced = X;
  return std::ssize(reduce(reduced));
}

ExactMatrix image(const ExactMatrix& X) {
  ExactMatrix reduced = X;
  const std::vector<Index> pivots = reduce(reduced);
  ExactMatrix basis(X.rows(), std::ssize(pivots));
  for (Index i = 0; i < X.rows(); ++i) {
    for (Index j = 0; j < basis.cols(); ++j) {
      basis.at(i, j) = X.at(i, pivots[static_cast<std::size_t>(j)]);
    }
  }
  return basis;
}

ExactMatrix kernel(const ExactMatrix& X) {
  ExactMatrix reduced = X;
  const std::vector<Index> pivots = reduce(reduced);
  std::vector<bool> is_pivot(static_cast<std::size_t>(X.cols()), false);
  for (const Index j : pivots) {
    is_pivot[static_cast<std::size_t>(j)] = true;
  }
  ExactMatrix basis(X.cols(), X.cols() - std::ssize(pivots));
  Index next = 0;
  for (Index j = 0; j < X.cols(); ++j) {
    if (is_pivot[static_cast<std::size_t>(j)]) {
      continue;
    }
    basis.at(j, next) = 1;
    for (Index i = 0; i < std::ssize(pivots); ++i) {
      basis.at(pivots[static_cast<std::size_t>(i)], next) = minus(0, reduced.at(i, j));
    }
    ++next;
  }
  return basis;
}

ExactSubspaces exact_unobservability_subspaces(const ExactMatrix& A, const ExactMatrix& C,
                                               const ExactMatrix& L) {
  // W_i = Im L + A (W_{i-1} ∩ Ker C)
  ExactMatrix W = image(L);
  for (;;) {
    ExactMatrix next = image(side_by_side(W, A * (W * kernel(C * W))));
    if (next.cols() == W.cols()) {
      break;
    }
    W = std::move(next);
  }
  // S_i = W + {x ∈ Ker C: A x ∈ S_{i-1}}; the rows of N are what vanishes on S_{i-1}.
  ExactMatrix S = kernel(ExactMatrix(1, A.rows()));
  for (;;) {
    const ExactMatrix N = transpose(kernel(transpose(S)));
    ExactMatrix next = image(side_by_side(W, kernel(stacked(N * A, C))));
    if (next.cols() == S.cols()) {
      break;
    }
    S = std::move(next);
  }
  return {W, S};
}

ExactMatrix exact_transfer(const ExactMatrix& A, const ExactMatrix& B, const ExactMatrix& C,
                           const ExactMatrix& D, std::uint64_t lambda) {
  const Index n = A.rows();
  // [λI - A  B] reduced to [I  (λI - A)⁻¹ B].
  ExactMatrix pencil(n, n);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) {
      pencil.at(i, j) = minus(i == j ? lambda : 0, A.at(i, j));
    }
  }
  ExactMatrix system = side_by_side(pencil, B);
  const std::vector<Index> pivots = reduce(system);
  if (std::ssize(pivots) != n || (n > 0 && pivots.back() != n - 1)) {
    std::abort();  // λ is an eigenvalue of A
  }
  ExactMatrix X(n, B.cols());
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < B.cols(); ++j) {
      X.at(i, j) = system.at(i, n + j);
    }
  }
  ExactMatrix T = C * X;
  for (Index i = 0; i < T.rows(); ++i) {
    for (Index j = 0; j < T.cols(); ++j) {
      T.at(i, j) = plus(T.at(i, j), D.at(i, j));
    }
  }
  return T;
}

}  // namespace faultline

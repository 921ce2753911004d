#include "diagnosis/design/pole_placement.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>

#include <Eigen/LU>
#include <Eigen/QR>
#include <fmt/format.h>

#include "diagnosis/design/subspace.h"
#include "diagnosis/model/riccati.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Poles = std::vector<std::complex<double>>;

// Sweeps over all eigenvectors: the method converges in a handful (ibid., section 6).
constexpr int kSweeps = 12;
// A sweep that gains less than a tenth is the last one.
constexpr double kWorthwhile = 0.9;
// Starts from different vectors, the best is kept: the result depends on the start only mildly.
constexpr std::uint64_t kStarts = 4;
// Well enough conditioned to try no further start: the spectrum comes out with ten digits.
constexpr double kGoodCondition = 1e5;
// Replacing a column by a unit vector with a smaller pivot would lose half the digits.
constexpr double kSmallestPivot = 1e-8;
// Beyond this condition the eigenvectors are dependent to working precision, and the spectrum
// would come out with less than five digits.
constexpr double kMaxCondition = 1e10;

// Numbers in [-1, 1) that are the same everywhere: splitmix64, Steele, Lea, Flood, OOPSLA 2014.
class Sequence {
 public:
  explicit Sequence(std::uint64_t seed) : state_(seed) {}
  double next() {
    state_ += 0x9e3779b97f4a7c15;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    z ^= z >> 31;
    return std::ldexp(static_cast<double>(z >> 11), -52) - 1.0;
  }

 private:
  std::uint64_t state_;
};

bool is_first_of_pair(const Poles& poles, Index i) {
  const auto at = static_cast<std::size_t>(i);
  return poles[at].imag() != 0.0 && at + 1 < poles.size() && poles[at + 1] == std::conj(poles[at]);
}

// Columns that an eigenvector occupies: a complex one takes its conjugate along.
Index width(const Poles& poles, Index i) { return is_first_of_pair(poles, i) ? 2 : 1; }

// Last `count` columns of Q in X = Q R: orthogonal to Im X if X has n - count columns of full rank.
MatrixXcd orthogonal_columns(const MatrixXcd& X, Index count) {
  if (X.cols() == 0) {
    return MatrixXcd::Identity(X.rows(), X.rows()).rightCols(count);
  }
  const Eigen::HouseholderQR<MatrixXcd> qr(X);
  const MatrixXcd Q = qr.householderQ();
  return Q.rightCols(count);
}

// Per pole: orthonormal basis of the eigenvectors that feedback through M can give, i.e. of
// Ker U_1ᵀ (A_0ᵀ - λ I), where U_1 spans the complement of Im Mᵀ.
std::vector<MatrixXcd> attainable_eigenvectors(const MatrixXd& A_0, const MatrixXd& U_1,
                                               const Poles& poles) {
  const Index d = A_0.rows();
  std::vector<MatrixXcd> spaces;
  for (const std::complex<double>& pole : poles) {
    const MatrixXcd pencil =
        A_0.cast<std::complex<double>>() - std::conj(pole) * MatrixXcd::Identity(d, d);
    spaces.push_back(orthogonal_columns(pencil * U_1, d - U_1.cols()));
  }
  return spaces;
}

void set_eigenvector(MatrixXcd& X, const Poles& poles, Index i, const VectorXcd& x) {
  X.col(i) = x.normalized();
  if (width(poles, i) == 2) {
    X.col(i + 1) = X.col(i).conjugate();
  }
}

MatrixXcd starting_vectors(const std::vector<MatrixXcd>& spaces, const Poles& poles,
                           std::uint64_t seed) {
  const auto d = static_cast<Index>(poles.size());
  Sequence sequence(seed);
  MatrixXcd X(d, d);
  for (Index i = 0; i < d; i += width(poles, i)) {
    const MatrixXcd& space = spaces[static_cast<std::size_t>(i)];
    VectorXcd weights(space.cols());
    for (auto& weight : weights) {
      const double real = sequence.next();
      weight = {real, width(poles, i) == 2 ? sequence.next() : 0.0};
    }
    set_eigenvector(X, poles, i, space * weights);
  }
  return X;
}

// ‖X‖_F ‖X⁻¹‖_F; infinite if X is singular to working precision.
double condition(const MatrixXcd& X, const MatrixXcd& X_inverse) {
  const double value = X.norm() * X_inverse.norm();
  return std::isfinite(value) ? value : std::numeric_limits<double>::infinity();
}

// X with column i replaced by x, and its inverse with it (Sherman, Morrison). False, and nothing
// changed, if the new X were singular to working precision.
bool replace_column(MatrixXcd& X, MatrixXcd& X_inverse, Index i, const VectorXcd& x) {
  const VectorXcd change = X_inverse * (x - X.col(i));
  const std::complex<double> pivot = 1.0 + change[i];
  if (!(std::abs(pivot) > kSmallestPivot)) {
    return false;
  }
  const Eigen::RowVectorXcd row = X_inverse.row(i) / pivot;
  X_inverse.noalias() -= change * row;
  X.col(i) = x;
  return true;
}

// Turns each eigenvector, within its space, as far away from all others as it goes: row i of X⁻¹ is
// orthogonal to all columns of X but the i-th.
void sweep(MatrixXcd& X, MatrixXcd& X_inverse, const std::vector<MatrixXcd>& spaces,
           const Poles& poles) {
  for (Index i = 0; i < X.cols(); i += width(poles, i)) {
    const VectorXcd normal = X_inverse.row(i).adjoint().normalized();
    const MatrixXcd& space = spaces[static_cast<std::size_t>(i)];
    VectorXcd x = space * (space.adjoint() * normal);
    if (!(x.norm() > std::numeric_limits<double>::epsilon())) {
      continue;
    }
    x.normalize();
    if (replace_column(X, X_inverse, i, x) && width(poles, i) == 2) {
      replace_column(X, X_inverse, i + 1, x.conjugate());
    }
  }
}

// Sweeps from one start until they gain no more. Updates `best` if they end below `least`.
void sweep_from(std::uint64_t start, const std::vector<MatrixXcd>& spaces, const Poles& poles,
                MatrixXcd& best, double& least) {
  MatrixXcd X = starting_vectors(spaces, poles, start);
  double before = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= kSweeps; ++i) {
    // Anew each time: the updates of a sweep add up their rounding errors.
    MatrixXcd X_inverse = X.partialPivLu().inverse();
    const double value = condition(X, X_inverse);
    if (value < least) {
      least = value;
      best = X;
    }
    if (!(value < kWorthwhile * before)) {
      return;
    }
    before = value;
    sweep(X, X_inverse, spaces, poles);
  }
}

// Empty if no start gave independent eigenvectors.
MatrixXcd best_eigenvectors(const std::vector<MatrixXcd>& spaces, const Poles& poles,
                            double& least) {
  MatrixXcd best;
  least = std::numeric_limits<double>::infinity();
  for (std::uint64_t start = 0; start < kStarts && !(least < kGoodCondition); ++start) {
    sweep_from(start, spaces, poles, best, least);
  }
  return best;
}

std::string refuse_multiplicity(const Poles& poles, Index rank) {
  for (const std::complex<double>& pole : poles) {
    const auto times = std::count(poles.begin(), poles.end(), pole);
    if (times > rank) {
      return fmt::format(
          "{}{:+}i is asked for {} times, but no pole can be had more often than the residual has "
          "independent rows ({}): at least {} different poles are needed",
          pole.real(), pole.imag(), times, rank,
          (static_cast<Index>(poles.size()) + rank - 1) / rank);
    }
  }
  return "";
}

}  // namespace

MatrixXd real_block_diagonal(const Poles& poles) {
  const auto d = static_cast<Index>(poles.size());
  MatrixXd blocks = MatrixXd::Zero(d, d);
  for (Index i = 0; i < d; i += width(poles, i)) {
    const std::complex<double> pole = poles[static_cast<std::size_t>(i)];
    blocks(i, i) = pole.real();
    if (width(poles, i) == 2) {
      blocks.block<2, 2>(i, i) << pole.real(), pole.imag(), -pole.imag(), pole.real();
    }
  }
  return blocks;
}

PolePlacement place_poles(const MatrixXd& A_0, const MatrixXd& M, const Poles& poles) {
  const Index d = A_0.rows();
  assert(static_cast<Index>(poles.size()) == d && M.cols() == d);
  PolePlacement result;
  if (d == 0) {
    result.is_possible = true;
    result.D_1 = MatrixXd::Zero(0, M.rows());
    return result;
  }
  SubspaceArithmetic arithmetic;
  const MatrixXd U_0 = arithmetic.image(M.transpose(), M.norm());
  result.reason = refuse_multiplicity(poles, U_0.cols());
  if (!result.reason.empty()) {
    return result;
  }
  MatrixXd F;
  if (U_0.cols() == d) {
    // Every F can be had: the normal one is the best conditioned.
    F = real_block_diagonal(poles);
    result.condition = static_cast<double>(d);
  } else {
    const std::vector<MatrixXcd> spaces = attainable_eigenvectors(A_0, complement(U_0), poles);
    const MatrixXcd X = best_eigenvectors(spaces, poles, result.condition);
    if (!(result.condition < kMaxCondition)) {
      result.reason = fmt::format(
          "these {} poles have no independent eigenvectors here (condition {:.0e}): give more "
          "different ones, nearer to the plant's own rates, or decay_rate_per_s instead",
          d, result.condition);
      return result;
    }
    const MatrixXcd spectrum = Eigen::Map<const VectorXcd>(poles.data(), d).asDiagonal();
    F = (X * spectrum * X.inverse()).real().transpose();
  }
  result.D_1 = (F - A_0) * arithmetic.pseudo_inverse(M, M.norm());
  result.is_possible = true;
  return result;
}

PolePlacement place_decay(const MatrixXd& A_0, const MatrixXd& M, double decay, bool is_sampled) {
  const Index d = A_0.rows();
  PolePlacement result;
  if (d == 0) {
    result.is_possible = true;
    result.D_1 = MatrixXd::Zero(0, M.rows());
    return result;
  }
  const MatrixXd I = MatrixXd::Identity(d, d);
  const MatrixXd R = MatrixXd::Identity(M.rows(), M.rows());
  const double M_size = M.norm();
  try {
    if (is_sampled) {
      const MatrixXd Q = I / (M_size * M_size);
      result.D_1 = -decay * lqr_gain(A_0.transpose() / decay, M.transpose(), Q, R).transpose();
    } else {
      const double mu = decay / M_size;
      const MatrixXd A_shifted = (A_0 + decay * I).transpose();
      result.D_1 = -solve_care(A_shifted, M.transpose(), mu * mu * I, R) * M.transpose();
    }
    result.is_possible = true;
  } catch (const std::invalid_argument& error) {
    result.reason = fmt::format("the decay rate cannot be had: {}", error.what());
  }
  return result;
}

}  // namespace faultline

#include "diagnosis/design/eigenstructure/assignment.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/design/geometric.h"
#include "diagnosis/design/joined_matrices.h"
#include "diagnosis/design/observable_part.h"
#include "diagnosis/design/pole_placement.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Pole = std::complex<double>;
using Poles = std::vector<Pole>;

std::string pole_text(Pole pole) {
  return pole.imag() == 0.0 ? fmt::format("{:g}", pole.real())
                            : fmt::format("{:g}{:+g}i", pole.real(), pole.imag());
}

void check_plant(const MatrixXd& A, const MatrixXd& C, const MatrixXd& E) {
  const Index n = A.rows();
  if (n == 0 || A.cols() != n || C.cols() != n || C.rows() == 0 || E.rows() != n) {
    throw std::invalid_argument(
        fmt::format("found A {}×{}, C {}×{}, E {}×{}, expected n×n, q×n, n×l with n, q >= 1",
                    A.rows(), A.cols(), C.rows(), C.cols(), E.rows(), E.cols()));
  }
  if (!A.allFinite() || !C.allFinite() || !E.allFinite()) {
    throw std::invalid_argument("found NaN or infinity in A, C or E, expected finite numbers");
  }
}

bool is_stable(Pole pole, bool is_sampled) {
  return is_sampled ? std::abs(pole) < 1.0 : pole.real() < 0.0;
}

void check_poles(const Poles& poles, Index n, bool is_sampled) {
  if (std::ssize(poles) != n) {
    throw std::invalid_argument(
        fmt::format("found {} poles, expected {}: one per state", poles.size(), n));
  }
  for (std::size_t i = 0; i < poles.size(); ++i) {
    if (!std::isfinite(poles[i].real()) || !std::isfinite(poles[i].imag()) ||
        !is_stable(poles[i], is_sampled)) {
      throw std::invalid_argument(fmt::format(
          "found pole {}, expected {}", pole_text(poles[i]),
          is_sampled ? "poles inside the unit circle"
                     : "negative real parts (dead-beat, 0, is stable in discrete time only)"));
    }
    if (poles[i].imag() == 0.0) {
      continue;
    }
    if (i + 1 == poles.size() || poles[i + 1] != std::conj(poles[i])) {
      throw std::invalid_argument(fmt::format("found pole {}, expected its conjugate {} behind it",
                                              pole_text(poles[i]), pole_text(std::conj(poles[i]))));
    }
    ++i;
  }
}

// The first `count` of `poles` that keep pairs together, taken out of it; none if that cannot be.
std::optional<Poles> take(Poles& poles, Index count) {
  Poles taken;
  Poles left;
  for (std::size_t i = 0; i < poles.size(); ++i) {
    const bool is_pair = poles[i].imag() != 0.0;
    const Index room = count - std::ssize(taken);
    Poles& to = room >= (is_pair ? 2 : 1) ? taken : left;
    to.push_back(poles[i]);
    if (is_pair) {
      to.push_back(poles[++i]);
    }
  }
  if (std::ssize(taken) < count) {
    return std::nullopt;
  }
  poles = std::move(left);
  return taken;
}

std::string no_real_pole(Index count) {
  return fmt::format("the poles are complex pairs only, and {} of them are needed: give a real one",
                     count);
}

// Basis of Im E.
MatrixXd directions_basis(const MatrixXd& E, SubspaceArithmetic& arithmetic) {
  MatrixXd basis = arithmetic.image(unit_columns(E), 1.0);
  if (basis.cols() == 0) {
    throw std::invalid_argument(
        "found E without a column that is not zero, expected the directions of unknown inputs: "
        "without any there is nothing to decouple");
  }
  return basis;
}

// A part Z of the gain that places what can be placed of A - Z C, or why it cannot be had.
struct FreePart {
  MatrixXd Z;
  Poles fixed;
  std::string reason;
};

FreePart place_free_part(const MatrixXd& A, const MatrixXd& C, Poles& poles, bool is_sampled,
                         const char* what_is_fixed, SubspaceArithmetic& arithmetic) {
  const ObservablePart part = observable_part(A, C, arithmetic);
  FreePart free{MatrixXd::Zero(A.rows(), C.rows()), part.unobservable, ""};
  for (const Pole pole : free.fixed) {
    if (!is_stable(pole, is_sampled)) {
      free.reason = fmt::format("{} {} stays in A - K C whatever the gain, and is not stable",
                                what_is_fixed, pole_text(pole));
      return free;
    }
  }
  const std::optional<Poles> taken = take(poles, part.A.rows());
  if (!taken) {
    free.reason = no_real_pole(part.A.rows());
    return free;
  }
  const PolePlacement placement = place_poles(part.A, part.C, *taken);
  free.reason = placement.reason;
  if (placement.is_possible) {
    free.Z = -part.basis * placement.D_1;
  }
  return free;
}

// Λ of right eigenvectors: on k with C Ê k = 0 it is Ê⁺ A Ê k, elsewhere free.
struct RightBlock {
  bool is_solvable = false;
  MatrixXd fixed;  // Ê⁺ A Ê on Ker C Ê, zero on its complement
  MatrixXd free;   // Λ = fixed + Y free, Y any
};

RightBlock right_block(const MatrixXd& A, const MatrixXd& C, const MatrixXd& E_basis,
                       SubspaceArithmetic& arithmetic) {
  const MatrixXd C_unit = C / data_scale(C);
  const MatrixXd A_unit = A / data_scale(A);
  const MatrixXd unseen = arithmetic.kernel(C_unit * E_basis, 1.0);
  const MatrixXd moved = A_unit * E_basis * unseen;
  const MatrixXd leaves = moved - E_basis * (E_basis.transpose() * moved);
  RightBlock block;
  block.is_solvable = arithmetic.image(leaves, 1.0).cols() == 0;
  block.fixed = E_basis.transpose() * A * E_basis * unseen * unseen.transpose();
  block.free = complement(unseen).transpose();
  return block;
}

// Ker (C Ê)ᵀ without the static weights, as rows.
MatrixXd dynamic_weights(const MatrixXd& C, const MatrixXd& E_basis,
                         SubspaceArithmetic& arithmetic) {
  const MatrixXd C_unit = C / data_scale(C);
  const MatrixXd reached = arithmetic.image(C_unit, 1.0);
  const MatrixXd basis = reached * arithmetic.kernel((C_unit * E_basis).transpose() * reached, 1.0);
  return canonical_rows(basis * basis.transpose(), basis.cols());
}

std::string existence_text(const DecouplingExistence& existence) {
  if (!existence.exists()) {
    return fmt::format(
        "no residual of any kind keeps these unknown inputs out: rank C W* = rank C = {}",
        existence.rank_C);
  }
  return fmt::format("rank C W* = {} < rank C = {}: a residual exists by the geometric method",
                     existence.rank_CW, existence.rank_C);
}

}  // namespace

DecouplingWeights decoupling_weights(const MatrixXd& C, const MatrixXd& E) {
  if (C.rows() == 0 || C.cols() == 0 || E.rows() != C.cols()) {
    throw std::invalid_argument(
        fmt::format("found C {}×{}, E {}×{}, expected q×n, n×l with q, n "
                    ">= 1",
                    C.rows(), C.cols(), E.rows(), E.cols()));
  }
  if (!C.allFinite() || !E.allFinite()) {
    throw std::invalid_argument("found NaN or infinity in C or E, expected finite numbers");
  }
  SubspaceArithmetic arithmetic;
  const MatrixXd C_unit = C / data_scale(C);
  const MatrixXd E_basis = arithmetic.image(unit_columns(E), 1.0);
  const MatrixXd reached = arithmetic.image(C_unit, 1.0);
  DecouplingWeights weights;
  weights.rank_C = reached.cols();
  weights.W_dynamic = dynamic_weights(C, E_basis, arithmetic);
  weights.rank_CE = weights.rank_C - weights.W_dynamic.rows();
  const MatrixXd checks = MatrixXd::Identity(C.rows(), C.rows()) - reached * reached.transpose();
  weights.W_static = canonical_rows(checks, C.rows() - weights.rank_C);
  return weights;
}

MatrixXd left_weights(const MatrixXd& A, const MatrixXd& C, const MatrixXd& E,
                      SubspaceArithmetic& arithmetic) {
  const MatrixXd C_unit = C / data_scale(C);
  const MatrixXd A_unit = A / data_scale(A);
  const MatrixXd E_basis = arithmetic.image(unit_columns(E), 1.0);
  const MatrixXd N_C = arithmetic.kernel(C_unit, 1.0);
  const MatrixXd reached = arithmetic.image(C_unit, 1.0);
  const MatrixXd seen = side_by_side(C_unit * E_basis, C_unit * A_unit * N_C);
  const MatrixXd basis = reached * arithmetic.kernel(seen.transpose() * reached, 1.0);
  return canonical_rows(basis * basis.transpose(), basis.cols());
}

EigenstructureAssignment assign_left(const MatrixXd& A, const MatrixXd& C, const MatrixXd& E,
                                     const Poles& poles, bool is_sampled) {
  check_plant(A, C, E);
  check_poles(poles, A.rows(), is_sampled);
  SubspaceArithmetic arithmetic;
  static_cast<void>(directions_basis(E, arithmetic));
  EigenstructureAssignment found;
  found.W = left_weights(A, C, E, arithmetic);
  const Index p = found.W.rows();
  if (p == 0) {
    const DecouplingExistence existence = decoupling_existence(A, C, E);
    found.reason = fmt::format(
        "no left eigenvectors: w [CE, C A N_C] = 0 has static solutions only (rank C = {}, rank CE "
        "= {}); {}",
        existence.rank_C, existence.rank_CE, existence_text(existence));
    return found;
  }
  Poles remaining = poles;
  const std::optional<Poles> of_lambda = take(remaining, p);
  if (!of_lambda) {
    found.reason = no_real_pole(p);
    return found;
  }
  const MatrixXd H = found.W * C;
  found.basis = H;
  found.Lambda = real_block_diagonal(*of_lambda);
  const MatrixXd HK = (H * A - found.Lambda * H) * arithmetic.pseudo_inverse(C, data_scale(C));
  const MatrixXd K_0 = arithmetic.pseudo_inverse(H, data_scale(H)) * HK;
  const MatrixXd N = arithmetic.kernel(H, data_scale(H));
  FreePart free = place_free_part(N.transpose() * (A - K_0 * C) * N, C * N, remaining, is_sampled,
                                  "the mode that the outputs do not see,", arithmetic);
  found.fixed = std::move(free.fixed);
  found.reason = std::move(free.reason);
  found.is_possible = found.reason.empty();
  if (found.is_possible) {
    found.K = K_0 + N * free.Z;
  }
  return found;
}

EigenstructureAssignment assign_right(const MatrixXd& A, const MatrixXd& C, const MatrixXd& E,
                                      const Poles& poles, bool is_sampled) {
  check_plant(A, C, E);
  check_poles(poles, A.rows(), is_sampled);
  SubspaceArithmetic arithmetic;
  const MatrixXd E_basis = directions_basis(E, arithmetic);
  EigenstructureAssignment found;
  found.basis = E_basis;
  found.W = dynamic_weights(C, E_basis, arithmetic);
  const DecouplingExistence existence = decoupling_existence(A, C, E);
  if (found.W.rows() == 0) {
    found.reason = fmt::format(
        "no weight: w C E = 0 has static solutions only (rank CE = rank C = "
        "{}); {}",
        existence.rank_C, existence_text(existence));
    return found;
  }
  const RightBlock block = right_block(A, C, E_basis, arithmetic);
  if (!block.is_solvable) {
    found.reason = fmt::format(
        "no right eigenvectors: K C E = A E - E Λ has no solution, as an unknown input that moves "
        "no output at first moves the states out of Im E; {}",
        existence_text(existence));
    return found;
  }
  Poles remaining = poles;
  FreePart lambda = place_free_part(block.fixed, block.free, remaining, is_sampled,
                                    "the mode that the outputs do not see,", arithmetic);
  if (!lambda.reason.empty()) {
    found.reason = std::move(lambda.reason);
    return found;
  }
  found.Lambda = block.fixed - lambda.Z * block.free;
  const MatrixXd CE = C * E_basis;
  const MatrixXd K_0 =
      (A * E_basis - E_basis * found.Lambda) * arithmetic.pseudo_inverse(CE, data_scale(C));
  const MatrixXd N = complement(E_basis);
  FreePart free =
      place_free_part(N.transpose() * (A - K_0 * C) * N, found.W * C * N, remaining, is_sampled,
                      "the invariant zero of the plant from the unknown inputs,", arithmetic);
  found.fixed = std::move(lambda.fixed);
  found.fixed.insert(found.fixed.end(), free.fixed.begin(), free.fixed.end());
  found.reason = std::move(free.reason);
  found.is_possible = found.reason.empty();
  if (found.is_possible) {
    found.K = K_0 + N * free.Z * found.W;
  }
  return found;
}

DecouplingExistence decoupling_existence(const MatrixXd& A, const MatrixXd& C, const MatrixXd& E) {
  check_plant(A, C, E);
  SubspaceArithmetic arithmetic;
  const DecouplingWeights weights = decoupling_weights(C, E);
  const MatrixXd E_basis = arithmetic.image(unit_columns(E), 1.0);
  const UnobservabilitySubspaces spaces = unobservability_subspaces(A, C, E, arithmetic);
  DecouplingExistence existence;
  existence.rank_C = weights.rank_C;
  existence.rank_CE = weights.rank_CE;
  existence.rank_CW = arithmetic.image(C / data_scale(C) * spaces.W, 1.0).cols();
  existence.left_rows = left_weights(A, C, E, arithmetic).rows();
  const RightBlock block = right_block(A, C, E_basis, arithmetic);
  existence.is_right_solvable = block.is_solvable && weights.W_dynamic.rows() > 0;
  if (existence.is_right_solvable) {
    // A - K_0 C on the complement of Im E, for any Λ: what W C does not see of it.
    const MatrixXd K_0 = (A * E_basis - E_basis * block.fixed) *
                         arithmetic.pseudo_inverse(C * E_basis, data_scale(C));
    const MatrixXd N = complement(E_basis);
    existence.zeros =
        observable_part(N.transpose() * (A - K_0 * C) * N, weights.W_dynamic * C * N, arithmetic)
            .unobservable;
  }
  return existence;
}

}  // namespace faultline

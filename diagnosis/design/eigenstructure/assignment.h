#pragma once

#include <complex>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/subspace.h"

namespace faultline {

/// Residual r = W (y - C x̂) of an observer x̂' = A x̂ + B u + K (y - C x̂), with e = x - x̂:
///
///   e' = (A - K C) e + E d,  r = W C e,  H = W C
///
/// x' is dx/dt or x_k+1. A n×n, C q×n, E n×l: the columns in which unknown inputs d enter. K n×q,
/// W p×q.
///
/// Rows w with w C E = 0: the first condition of every assignment.
struct DecouplingWeights {
  Eigen::MatrixXd W_dynamic;  ///< rank C - rank CE rows, orthonormal, orthogonal to the static ones
  Eigen::MatrixXd W_static;   ///< q - rank C rows, orthonormal: w C = 0, no state enters r = w y;
                              ///< they check sensors against each other and see no fault of a plant
  Eigen::Index rank_C = 0;
  Eigen::Index rank_CE = 0;
};

/// Their number is rank C - rank CE (dynamic ones): {w: w C E = 0} has dimension q - rank CE, and
/// w → w C takes the q - rank C static ones of it to zero. (Jin, Zhang, theorem 1, names n - rank E
/// at most, which more often than not is more than there are, and asks for two conditions of which
/// the second implies the first.)
/// @throws std::invalid_argument shapes that do not fit, or numbers that are not finite
[[nodiscard]] DecouplingWeights decoupling_weights(const Eigen::MatrixXd& C,
                                                   const Eigen::MatrixXd& E);

/// The weights of left eigenvectors: w [C E, C A N_C] = 0 with N_C = Ker C, whatever Λ is to be, as
/// orthonormal rows orthogonal to the static ones. H = W C has full row rank, and
///
///   H A = X C for one X
///
/// A n×n, C q×n, E n×l.
[[nodiscard]] Eigen::MatrixXd left_weights(const Eigen::MatrixXd& A, const Eigen::MatrixXd& C,
                                           const Eigen::MatrixXd& E,
                                           SubspaceArithmetic& arithmetic);

/// An observer whose residual d does not reach, at any frequency.
struct EigenstructureAssignment {
  bool is_possible = false;
  std::string reason;  ///< why not; empty if possible
  Eigen::MatrixXd W;   ///< p×q: dynamic rows
  Eigen::MatrixXd K;   ///< n×q
  Eigen::MatrixXd Lambda;  ///< left: H (A - K C) = Λ H; right: (A - K C) Ê = Ê Λ, Ê = basis of Im E
  Eigen::MatrixXd basis;  ///< left: H, p×n; right: Ê, n×rank E
  /// Eigenvalues of A - K C that no gain moves: modes that the outputs do not see (left), and
  /// invariant zeros of (A, E, C) (right). All of them stable if it is possible.
  std::vector<std::complex<double>> fixed;
};

/// Left eigenvectors: the rows of H = W C span a left invariant subspace of A - K C:
///
///   H (A - K C) = Λ H:  H K = (H A - Λ H) C⁺,  K = H⁺ H K + N Z,  N = Ker H
///   σ(A - K C) = σ(Λ) ∪ σ(Nᵀ (A - H⁺ H K C) N - Z C N)
///
/// Feasible iff w [C E, C A N_C] = 0 has a solution with w C ≠ 0, for any Λ. `poles`: n of them,
/// conjugates side by side; the first p are Λ's, of the others as many as can be placed are taken.
/// `is_sampled`: z plane, where all of them may be zero (dead-beat); in the s plane a zero
/// eigenvalue (the paper's H A_0 = 0) is not stable and refused.
/// Jin Hong, Zhang Hongyue, section 2, with Λ for their 0; Patton, Chen, CDC 1991, 2242-2247.
/// @throws std::invalid_argument shapes, numbers that are not finite; E zero; poles that are not
///   stable, unpaired, or not n.
[[nodiscard]] EigenstructureAssignment assign_left(const Eigen::MatrixXd& A,
                                                   const Eigen::MatrixXd& C,
                                                   const Eigen::MatrixXd& E,
                                                   const std::vector<std::complex<double>>& poles,
                                                   bool is_sampled);

/// Right eigenvectors: Im E is an invariant subspace of A - K C, and all of Ker (CE)ᵀ are weights:
///
///   K C Ê = A Ê - Ê Λ,  K = (A Ê - Ê Λ) (CÊ)⁺ + N Z W,  N = (Im E)^⊥,  W = Ker (CE)ᵀ
///   σ(A - K C) = σ(Λ) ∪ σ(Nᵀ (A - K_0 C) N - Z W C N)
///
/// Solvable iff A Ê k ∈ Im E for every k with C Ê k = 0 (always if CÊ has full column rank); then
/// on such k Λ is given, Λ k = Ê⁺ A Ê k, and the rest of Λ is placed. The second part cannot be
/// placed freely: its invariant zeros stay and must be stable. `poles` as above, the first rank E
/// for Λ.
[[nodiscard]] EigenstructureAssignment assign_right(const Eigen::MatrixXd& A,
                                                    const Eigen::MatrixXd& C,
                                                    const Eigen::MatrixXd& E,
                                                    const std::vector<std::complex<double>>& poles,
                                                    bool is_sampled);

/// Which ways there are to keep d = E d out of a residual.
struct DecouplingExistence {
  Eigen::Index rank_C = 0;
  Eigen::Index rank_CE = 0;
  Eigen::Index rank_CW = 0;        ///< C W*, W* the smallest (C, A)-invariant subspace over Im E
  Eigen::Index left_rows = 0;      ///< rows of left_weights()
  bool is_right_solvable = false;  ///< K C E = A E - E Λ has a solution, and dynamic weights exist
  /// Invariant zeros of (A, E, C) that right eigenvectors leave in A - K C.
  std::vector<std::complex<double>> zeros;

  /// Necessary and sufficient for a residual: rank C W* < rank C. Left and right eigenvectors are
  /// sufficient only.
  [[nodiscard]] bool exists() const { return rank_CW < rank_C; }
};
[[nodiscard]] DecouplingExistence decoupling_existence(const Eigen::MatrixXd& A,
                                                       const Eigen::MatrixXd& C,
                                                       const Eigen::MatrixXd& E);

}  // namespace faultline

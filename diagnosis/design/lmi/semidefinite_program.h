#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace faultline {

/// A semidefinite program with sparse data:
///
///   minimise cᵀx   subject to   Z_b = Σ_k x_k A_kb - C_b ⪰ 0   for every block b
///
/// and its dual: maximise Σ_b tr(C_b X_b) s.t. Σ_b tr(A_kb X_b) = c_k, X_b ⪰ 0.
struct SemidefiniteProgram {
  /// Entries (row, col) and (col, row) of A_variable in a block; of C if `variable` is -1.
  /// row <= col; at most one per place.
  struct Entry {
    Eigen::Index variable = 0;
    Eigen::Index block = 0;
    Eigen::Index row = 0;
    Eigen::Index col = 0;
    double value = 0.0;
  };
  std::vector<Eigen::Index> block_sizes;
  Eigen::VectorXd c;           ///< one per variable
  std::vector<Entry> entries;  ///< in any order
};

enum class SolverOutcome {
  kOptimal,
  kReducedAccuracy,  ///< stopped near the optimum
  kInfeasible,       ///< X is the proof: tr(A_k X) ≈ 0 for all k, tr(C X) > 0
  kUnbounded,        ///< x is the proof: Σ x_k A_k ⪰ 0 (nearly), cᵀx < 0
  kStuck,            ///< no progress, numbers that overflowed, too many iterations
  kTooLarge,         ///< not tried: see kLargestProgram
};

struct SolverAnswer {
  SolverOutcome outcome = SolverOutcome::kStuck;
  int code = 0;                    ///< the solver's own
  Eigen::VectorXd x;               ///< last iterate; never NaN unless kStuck
  std::vector<Eigen::MatrixXd> X;  ///< per block
  double objective = 0.0;          ///< cᵀx
  double dual_objective = 0.0;     ///< Σ tr(C X)
};

/// Variables a program may have: its Newton matrix is dense, m² numbers, m³/3 operations in each of
/// some 30 iterations. 1300 take half a minute with Debian's reference BLAS (2026).
inline constexpr Eigen::Index kLargestProgram = 1600;

/// Solves by CSDP 6.2 (B. Borchers, Optimization Methods and Software 11 (1999) 613-623), a
/// predictor-corrector interior-point method. Deterministic: one thread, parameters of our own
/// whatever `param.csdp` lies in the working directory, nothing printed. May be called from any
/// thread: calls wait for each other, because the solver keeps static data. A multi-threaded
/// OpenBLAS, if that is what the system's libblas is, works with one thread meanwhile: its threads
/// only get into each other's way on matrices of this size.
///
/// The answer is the solver's word; nothing is checked here.
/// @param residual  what may be left of the equations for Z, relative to 1 + ‖C‖; at most 1e-8
/// @pre every variable enters some block; entries are finite
/// @throws std::runtime_error if another library's `initparams` was called instead of ours
[[nodiscard]] SolverAnswer solve(const SemidefiniteProgram& program, double residual);

}  // namespace faultline

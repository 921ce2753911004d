#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/geometric.h"
#include "diagnosis/model/plant_model.h"

// Geometry for tests, written for them: shares nothing with diagnosis/design.
namespace faultline::reference {

/// Orthonormal basis of Im X; of X with its columns scaled to one, what is below 1e-9 is zero.
[[nodiscard]] Eigen::MatrixXd image(const Eigen::MatrixXd& X);
/// Orthonormal basis of Ker X for an X of about size one; singular values below 1e-9 are zero.
[[nodiscard]] Eigen::MatrixXd kernel(const Eigen::MatrixXd& X);
/// How far Im X is from lying in the span of the orthonormal `basis`: the largest distance of a
/// column, relative to `scale`.
[[nodiscard]] double outside(const Eigen::MatrixXd& basis, const Eigen::MatrixXd& X,
                             double scale = 1.0);
/// ‖Π_U - Π_V‖ for orthonormal bases.
[[nodiscard]] double distance(const Eigen::MatrixXd& U, const Eigen::MatrixXd& V);

/// S* of (C, A) for L through its dual: S*^⊥ is the largest controllability subspace of (Aᵀ, Cᵀ)
/// in Ker Lᵀ, which is what can be reached in the largest controlled invariant subspace V* there:
///
///   V_0 = Ker Lᵀ,  V_i = {v ∈ Ker Lᵀ: Aᵀ v ∈ V_{i-1} + Im Cᵀ};   (Aᵀ + Cᵀ K) V* ⊆ V*
///   S*^⊥ = ⟨Aᵀ + Cᵀ K | Im Cᵀ ∩ V*⟩
///
/// Wonham, Linear Multivariable Control, 3rd ed., theorems 4.3 and 5.4.
struct DualSubspaces {
  Eigen::MatrixXd W, S;
};
[[nodiscard]] DualSubspaces dual_unobservability_subspaces(const Eigen::MatrixXd& A,
                                                           const Eigen::MatrixXd& C,
                                                           const Eigen::MatrixXd& L);
/// ∩ Ker H A^i; in H, what is below 1e-9 of `scale` is zero.
[[nodiscard]] Eigen::MatrixXd unobservable_subspace(const Eigen::MatrixXd& H,
                                                    const Eigen::MatrixXd& A, double scale);

/// C (λ I - A)⁻¹ L + D of the directions, and what could at most have come out per column,
/// ‖C‖ ‖(λ I - A)⁻¹ L_j‖ + ‖D_j‖: rounding errors count relative to that.
struct Transfer {
  Eigen::MatrixXcd T;
  Eigen::VectorXd size;
};
[[nodiscard]] Transfer transfer(const PlantModel& plant, const Directions& directions,
                                std::complex<double> lambda);
/// Rank of T with its columns divided by their sizes; singular values below 1e-8 are zero.
[[nodiscard]] Eigen::Index rank(const Transfer& transfer);

[[nodiscard]] Directions fault_directions(const PlantModel& plant,
                                          const std::vector<std::size_t>& faults);
[[nodiscard]] Directions disturbance_directions(const PlantModel& plant);
[[nodiscard]] Directions side_by_side(const Directions& X, const Directions& Y);
[[nodiscard]] std::vector<std::size_t> all_faults(const PlantModel& plant);

/// What signals make of a residual at z, of the filter on the sampled plant.
struct Leak {
  double gain = 0.0;  ///< ‖T‖
  double size = 0.0;  ///< sum of the norms of what T is made of, and may cancel in it
  [[nodiscard]] double relative() const { return size > 0.0 ? gain / size : 0.0; }
};
/// Of the commands u, which the filter knows.
[[nodiscard]] Leak leak_of_inputs(const PlantModel& sampled, const ResidualFilter& filter,
                                  std::complex<double> z);
/// Of unknown signals that enter the plant at `directions`.
[[nodiscard]] Leak leak_of(const PlantModel& sampled, const ResidualFilter& filter,
                           const Directions& directions, std::complex<double> z);

/// The plant sampled exactly, everything held over a sample: exp([A B; 0 0] T) by its series.
[[nodiscard]] PlantModel sampled(const PlantModel& plant, double sample_time_s);

}  // namespace faultline::reference

#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// What the faults and disturbances that a residual ignores leave of the plant.
struct Decoupling {
  RankCertificate rank;
  std::vector<double> margin;  ///< per fault
};

/// The geometry behind a bank, by duality: with L the ignored directions,
///
///   W*^⊥ = V*, the largest (Aᵀ, Cᵀ)-controlled invariant subspace in Ker Lᵀ:
///          V_0 = Ker Lᵀ,  V_i+1 = V_i ∩ A⁻ᵀ (V_i + Im Cᵀ)
///   S*^⊥ = R*, the largest controllability subspace in V*:
///          R_0 = 0,       R_i+1 = V* ∩ (Aᵀ R_i + Im Cᵀ)
///
/// (Wonham, Linear Multivariable Control, 3rd ed., 4.3 and 5.2) in the bank's domain: (A, L), or
/// (A_d, L_d) of the sampled plant. Computed in balanced coordinates, so that the choice of units
/// for the states changes no dimension; margins are in the plant's own coordinates.
///
/// A direction (L_j, D_j) that reaches the output is decoupled through a state of its own in
/// (x, m_j), m_j' arbitrary. Disturbances taken as constant are states too, d' = 0 (d_k+1 = d_k),
/// and are not ignored. The dimensions count the second kind of added states, not the first.
class DecouplingAnalysis {
 public:
  /// @throws std::invalid_argument the sampled plant's numbers are not finite.
  DecouplingAnalysis(const PlantModel& plant, const Bank& bank);

  /// For a residual that ignores the faults `ignores` and the bank's decoupled disturbances.
  [[nodiscard]] Decoupling of(const std::vector<std::size_t>& ignores) const;

 private:
  // x' = A x + ..., y = C x + ... with the ignored directions' states behind the plant's own.
  struct ExtendedPlant {
    Eigen::Index added = 0;
    Eigen::MatrixXd A, C, L;
  };
  // Dimensions and bases (in the coordinates of the extended plant given).
  struct Subspaces {
    Eigen::Index dim_w = 0;
    Eigen::Index dim_s = 0;
    Eigen::MatrixXd S, S_complement;
    double smallest_kept = 0.0;
    double largest_dropped = 0.0;
  };

  [[nodiscard]] static ExtendedPlant extend(const Eigen::MatrixXd& A, const Eigen::MatrixXd& C,
                                            const Eigen::MatrixXd& states,
                                            const Eigen::MatrixXd& outputs);
  [[nodiscard]] static Subspaces subspaces(const ExtendedPlant& plant, double tolerance);
  [[nodiscard]] static RankCertificate rank_certificate(const ExtendedPlant& plant,
                                                        const Subspaces& found);
  // ‖(L_j, D_j) less what the residual cannot see‖ / ‖(L_j, D_j)‖ for the columns of `states` and
  // `outputs`; S and P span S* and S*^⊥ of `plant`.
  [[nodiscard]] static std::vector<double> distances(const ExtendedPlant& plant,
                                                     const Eigen::MatrixXd& S,
                                                     const Eigen::MatrixXd& P,
                                                     const Eigen::MatrixXd& states,
                                                     const Eigen::MatrixXd& outputs);
  [[nodiscard]] std::vector<double> margins(const ExtendedPlant& plain,
                                            const ExtendedPlant& balanced,
                                            const Subspaces& found) const;

  Eigen::MatrixXd A_, C_;                         // in the plant's coordinates
  Eigen::VectorXd state_scales_, output_scales_;  // balanced: x̃ = x / scale, ỹ = y / scale
  Eigen::MatrixXd fault_states_, fault_outputs_;  // per fault
  Eigen::MatrixXd decoupled_states_, decoupled_outputs_;  // per decoupled disturbance
};

}  // namespace faultline

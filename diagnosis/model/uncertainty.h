#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace faultline {

struct PlantModel;
class TomlTable;

/// What is not known of the plant's matrices:
///
///   x' = (A + Σ_i δ_i ΔA_i) x + (B + Σ_i δ_i ΔB_i) u + ..
///
/// A parameter has one pair, ΔA and ΔB at the end of its range, and |δ| <= 1. Other plants (points
/// of operation between which the real one lies) have a pair each, ΔA_i = A_i - A, ΔB_i = B_i - B,
/// and δ_i >= 0, Σ δ_i <= 1. ΔA_i n×n, ΔB_i n×m; x and u in deviations.
struct Uncertainty {
  std::string name;
  std::vector<Eigen::MatrixXd> delta_A, delta_B;  ///< as many of one as of the other
  bool is_parameter = true;
};

/// Reads the [[uncertainty]] tables of a plant file into `plant`, and adds to its disturbances the
/// unknown inputs that they are: with U an orthonormal basis of the image of
///
///   [ΔA_1 X ΔB_1 V ΔA_2 X ΔB_2 V ..],  X = diag(state ranges or ones), V = diag(input ranges)
///
/// Σ δ_i (ΔA_i x + ΔB_i u) = U d(t) whatever δ is, and may even vary: what ignores the columns of U
/// ignores the uncertainty. |d_j| <= max_i Σ |u_jᵀ ΔA_i| x̄ + |u_jᵀ ΔB_i| ū (where the state ranges
/// are known). One column is called by the uncertainty's name, several "NAME.1", "NAME.2" ..
///
/// d follows x within a sample; banks of the sampled domain take it for held, as all disturbances,
/// and leave a residue of the order of the sample time.
/// @throws InputError anything wrong in them, with line and column
void read_uncertainties(TomlTable& root, PlantModel& plant);

/// A and B of the plant that an uncertainty makes of `plant`: A + Σ δ_i ΔA_i, B + Σ δ_i ΔB_i, added
/// to the plant's own; the directions of its actuators' faults go with B. `delta`: one number per
/// pair. @pre it has
void apply_uncertainty(const Uncertainty& uncertainty, const std::vector<double>& delta,
                       PlantModel& plant);

}  // namespace faultline

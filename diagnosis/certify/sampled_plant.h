#pragma once

#include <map>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// The plant in the domain of a bank: continuous, or stepped as plant_step() says.
struct DomainModel {
  bool is_sampled = false;
  Eigen::MatrixXd A, B, C, D;
  Eigen::MatrixXd fault_states, fault_outputs;          ///< n×k, q×k
  Eigen::MatrixXd decoupled_states, decoupled_outputs;  ///< of the disturbances to be decoupled
  Eigen::MatrixXd constant_states, constant_outputs;    ///< of those taken as constant
};

/// @throws std::invalid_argument as plant_step().
[[nodiscard]] DomainModel domain_model(const PlantModel& plant, const Bank& bank);

/// The plant as the sampled loop sees it, inputs w = (u, m, d): m inputs, then k faults, then l
/// disturbances, all held over a sample (plant_step()),
///
///   x_k+1 = A_d x_k + B_d w_k,   y_k = C x_k + D w_k
///
/// split by an orthogonal change of coordinates into the modes near, on and beyond the unit circle
/// (ξ_1) and the rest (ξ_2), which drives them:
///
///   ξ_1' = A_11 ξ_1 + s_1,   s_1 = A_12 ξ_2 + B_1 w
///   ξ_2' = A_22 ξ_2 + B_2 w
///   y    = C_1 ξ_1 + y_2,    y_2 = C_2 ξ_2 + D w
///
/// A residual does not see ξ_1, or hardly: with F V_1 - V_1 A_11 = E C_1 the error e = v - V_1 ξ_1
/// follows s_1 and y_2 alone, which stay bounded for any bounded w. That is how the gains of a
/// filter on an unstable or integrating plant are finite numbers, to full precision.
class SampledPlant {
 public:
  /// `largest_radius` < 1: of the filters' spectral radii; modes with |λ| above both
  /// (1 + largest_radius)/2 and 1 - 1e-4 belong to ξ_1.
  /// @throws std::invalid_argument as domain_model().
  SampledPlant(const PlantModel& plant, const Bank& bank, double largest_radius);

  [[nodiscard]] Eigen::Index inputs() const { return B_2_.cols(); }
  [[nodiscard]] const Eigen::MatrixXd& A_11() const { return A_11_; }
  [[nodiscard]] const Eigen::MatrixXd& C_1() const { return C_1_; }
  [[nodiscard]] const Eigen::MatrixXd& A_12() const { return A_12_; }
  [[nodiscard]] const Eigen::MatrixXd& A_22() const { return A_22_; }
  [[nodiscard]] const Eigen::MatrixXd& B_1() const { return B_1_; }
  [[nodiscard]] const Eigen::MatrixXd& B_2() const { return B_2_; }
  [[nodiscard]] const Eigen::MatrixXd& C_2() const { return C_2_; }
  [[nodiscard]] const Eigen::MatrixXd& D() const { return D_; }
  /// Directions of the state, in the plant's coordinates, as (ξ_1; ξ_2). n×n.
  [[nodiscard]] const Eigen::MatrixXd& coordinates() const { return coordinates_; }
  /// A_11 = Z T Zᴴ, modes nearest to the unit circle first.
  [[nodiscard]] const Eigen::MatrixXcd& Z() const { return Z_; }
  [[nodiscard]] const Eigen::MatrixXcd& T() const { return T_; }

  /// D_f of the faults, and C L_d: their outputs one sample later. q×k.
  [[nodiscard]] Eigen::MatrixXd fault_outputs() const;
  [[nodiscard]] Eigen::MatrixXd fault_first_outputs() const;

  /// Per unit of each input, one column per input.
  struct Response {
    Eigen::MatrixXcd y_2, s_1;
    Eigen::MatrixXcd xi_1;  ///< Zᴴ ξ_1; closer than 1e-6 to a mode: the value at that distance
  };
  /// At z = e^(i angle). Computed once per angle.
  [[nodiscard]] const Response& at(double angle);

  /// Steps of all faults at once, from rest: y_2 and s_1 sample by sample, one column per fault.
  class FaultStep {
   public:
    explicit FaultStep(const SampledPlant& plant);
    [[nodiscard]] const Eigen::MatrixXd& y_2() const { return y_2_; }
    [[nodiscard]] const Eigen::MatrixXd& s_1() const { return s_1_; }
    void advance();

   private:
    void update();

    const SampledPlant& plant_;
    Eigen::MatrixXd xi_2_, next_, y_2_, s_1_;
  };

  /// Angles in [0, π] at which every filter is looked at, increasing: DC, Nyquist, a logarithmic
  /// grid from 1e-3 of the plant's slowest rate, and the lightly damped modes.
  [[nodiscard]] const std::vector<double>& angles() const { return angles_; }

 private:
  void split(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, const Eigen::MatrixXd& C,
             double largest_radius);
  void choose_angles(const Eigen::VectorXcd& modes);

  Eigen::Index fault_begin_ = 0, fault_count_ = 0;
  Eigen::MatrixXd A_11_, A_12_, A_22_, B_1_, B_2_, C_1_, C_2_, D_;
  Eigen::MatrixXd coordinates_;
  Eigen::MatrixXcd Z_, T_;
  std::vector<double> angles_;
  std::map<double, Response> responses_;
};

/// The angles of those λ whose resonance shows: complex, damping below 1/√2; nearest in nine
/// digits, so that equal modes of different filters give equal angles.
[[nodiscard]] std::vector<double> resonances(const Eigen::VectorXcd& modes);

}  // namespace faultline

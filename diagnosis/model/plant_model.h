#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/nonlinearity.h"
#include "diagnosis/model/uncertainty.h"

namespace faultline {

enum class TimeDomain { kContinuous, kDiscrete };
enum class FaultKind { kActuator, kSensor, kComponent };

/// A fault m_j: adds L_j m_j to the state equation and D_j m_j to the output equation.
struct Fault {
  std::string name;  ///< of the channel it sits on (actuators, sensors), else its own
  FaultKind kind = FaultKind::kComponent;
  Eigen::VectorXd state;   ///< L_j, n
  Eigen::VectorXd output;  ///< D_j, q
  double size = 1.0;       ///< what counts as a fault of size one, in the channel's unit
};

/// An unknown input d: adds E_d d to the state equation and D_f d to the output equation.
struct Disturbance {
  std::string name;
  Eigen::VectorXd state;        ///< n
  Eigen::VectorXd output;       ///< q
  std::optional<double> bound;  ///< |d| at most
  std::string uncertainty;      ///< the [[uncertainty]] that it stands for; empty: none
};

/// Measurement noise v: adds its column to the output equation.
struct Noise {
  std::string name;        ///< "noise1", "noise2", .. by position if the file gives none
  Eigen::VectorXd output;  ///< q
  std::optional<double> bound;
  std::optional<double> sigma;
};

/// Adds gain·E_o·φ(E_i x) to the state equation; x the deviation from the operating point.
struct Nonlinearity {
  NonlinearFunction function;  ///< φ
  double gain = 1.0;
  Eigen::VectorXd E_o;     ///< n
  Eigen::VectorXd E_i;     ///< n (a row of the equation)
  double slope_min = 0.0;  ///< bounds of the slope of φ; the file's may be wider than φ needs
  double slope_max = 0.0;
};

/// The plant as its file says it, with deviations taken from the operating point:
///
///   x' = A x + B u + Σ_j L_j m_j + E_d d + Σ gain·E_o·φ(E_i x)
///   y  = C x + D u + Σ_j D_j m_j + D_f d + noise
///
/// x' is dx/dt (continuous) or x_k+1 (discrete).
/// | symbol | shape |
/// |---|---|
/// | A | n×n |
/// | B | n×m |
/// | C | q×n |
/// | D | q×m |
struct PlantModel {
  std::string name;
  TimeDomain time = TimeDomain::kContinuous;
  std::optional<double> sample_time_s;  ///< discrete plants only
  std::vector<std::string> state_names, input_names, output_names;
  std::vector<std::string> state_units, input_units, output_units;  ///< empty, or one per name
  Eigen::VectorXd input_range, output_range;  ///< largest |deviation| to be expected, per channel
  /// Largest |deviation| of each state at any time, from which proofs start; absent: not known.
  std::optional<Eigen::VectorXd> state_range;
  Eigen::MatrixXd A, B, C, D;
  std::vector<Fault> faults;
  std::vector<Disturbance> disturbances;  ///< the file's, then those of the uncertainties
  std::vector<Noise> noises;
  std::vector<Nonlinearity> nonlinearities;
  std::vector<Uncertainty> uncertainties;
  Eigen::VectorXd x_operating, u_operating, y_operating;

  [[nodiscard]] Eigen::Index n() const { return A.rows(); }
  [[nodiscard]] Eigen::Index m() const { return B.cols(); }
  [[nodiscard]] Eigen::Index q() const { return C.rows(); }
  [[nodiscard]] std::vector<std::string> fault_names() const;
};

/// The plant with the rounding of its outputs as further noises: half of `resolution` (q, one LSB
/// of each; empty: none) as bound.
[[nodiscard]] PlantModel with_rounded_outputs(const PlantModel& model,
                                              const Eigen::VectorXd& resolution);

/// Name-based digest (RFC 4122, version 5) of everything in the model that a bank depends on:
/// names, numbers, time domain. Comments and layout of the file do not count, nor do the names of
/// noise sources, which only scenarios use.
[[nodiscard]] std::string plant_digest(const PlantModel& model);

}  // namespace faultline

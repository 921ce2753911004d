#pragma once

#include <complex>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A plant sampled about its operating point, u held over each sample:
///
///   x_k+1 = A x_k + B u_k,  y_k = C x_k + D u_k
///
/// A n×n, B n×m, C q×n, D q×m; deviations.
struct DiscretePlant {
  Eigen::MatrixXd A, B, C, D;
};

/// Linearised there first, nonlinearities by their slope at zero, and sampled exactly (a plant in
/// discrete time is taken as it is). @param sample_time_s > 0
[[nodiscard]] DiscretePlant sample_plant(const PlantModel& model, double sample_time_s);

/// A linear controller, in deviations:
///
///   ξ_k+1 = F ξ_k + G y_k,  u_k = H ξ_k + J y_k
///
/// F p×p, G p×q, H m×p, J m×q.
struct LinearController {
  Eigen::MatrixXd F, G, H, J;
};

/// u = J y.
[[nodiscard]] LinearController static_controller(const Eigen::MatrixXd& J);

/// The poles of a plant and a controller on one bus, where the command of cycle k acts from k+1 on:
/// the eigenvalues of (x, u_acting, ξ) → its successor. n + m + p of them, the largest first.
[[nodiscard]] std::vector<std::complex<double>> closed_loop_poles(
    const DiscretePlant& plant, const LinearController& controller);

/// Eigenvalues, the largest first.
[[nodiscard]] std::vector<std::complex<double>> poles_of(const Eigen::MatrixXd& A);

/// Checks that every mode of the plant that does not decay is seen by the outputs: the PBH test,
/// rank [A - λI; C] = n for every eigenvalue |λ| >= 1.
/// @throws std::invalid_argument one is not: names it and the state that it moves most.
void check_detectable(const DiscretePlant& plant, const std::vector<std::string>& state_names);
/// The same of the inputs: rank [A - λI, B] = n.
/// @throws std::invalid_argument likewise, of the state that no input holds.
void check_stabilisable(const DiscretePlant& plant, const std::vector<std::string>& state_names);

/// Process and measurement noise, as covariances per sample.
struct NoiseCovariances {
  Eigen::MatrixXd Q_w;  ///< n×n, of x_k+1
  Eigen::MatrixXd R_v;  ///< q×q, of y_k
};

/// What a plant file says of disturbances and noise: each as white noise of its sigma, or spread
/// evenly within its bound b (variance b²/3). Added are an unknown input of 1 % of each input's
/// range and a reading error of 0.1 % of each output's range: they keep the observer correcting
/// where the file names no disturbance, and R_v invertible.
[[nodiscard]] NoiseCovariances noise_covariances(const PlantModel& model, double sample_time_s);

/// Stationary Kalman predictor x̂_k+1 = A x̂_k + B u_k + L (y_k - C x̂_k - D u_k):
/// L = A P Cᵀ (C P Cᵀ + R_v)⁻¹, P the stabilising solution of the dual Riccati equation. n×q.
/// @throws std::invalid_argument as check_detectable and solve_dare.
[[nodiscard]] Eigen::MatrixXd kalman_gain(const DiscretePlant& plant,
                                          const NoiseCovariances& covariances,
                                          const std::vector<std::string>& state_names);

/// Where the plant can rest with chosen outputs at given values: x = N_x r, u = N_u r with
///
///   x = A x + B u,  S (C x + D u) = S r
///
/// S picks the outputs; the smallest (x, u) in the least-squares sense. N_x n×q, N_u m×q.
struct SteadyState {
  Eigen::MatrixXd N_x, N_u;

  /// |x - A x - B u| + |S (C x + D u - r)|, relative to |r|: 0 where r can be held.
  [[nodiscard]] double miss(const DiscretePlant& plant, const std::vector<Eigen::Index>& outputs,
                            const Eigen::VectorXd& r) const;
};
[[nodiscard]] SteadyState steady_state(const DiscretePlant& plant,
                                       const std::vector<Eigen::Index>& outputs);

/// C⁺, n×q: the smallest x with C x nearest to y.
[[nodiscard]] Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& C);

}  // namespace faultline

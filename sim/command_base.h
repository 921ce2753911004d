#pragma once

#include <cstdint>

#include <Eigen/Core>

namespace faultline {

/// What every control law commands besides its feedback, and the limits of its actuators:
///
///   u_k = clamp(u₀ + v + a sin(ω k) + feedback, u_min, u_max)
///
/// Absolute values; all of m channels. v the feed-forward, a sin(ω k) an excitation.
struct CommandBase {
  CommandBase() = default;
  /// Without excitation and limits. @param start u₀ + v
  explicit CommandBase(Eigen::VectorXd start);

  Eigen::VectorXd feedforward;   ///< u₀ + v
  Eigen::VectorXd amplitude;     ///< a
  Eigen::VectorXd omega_rad;     ///< ω: per cycle
  Eigen::VectorXd lower, upper;  ///< u_min <= u_max; infinite where there is none

  /// u₀ + v + a sin(ω k) into u. Real-time.
  void begin(std::uint32_t k, Eigen::VectorXd& u) const noexcept;
  /// Keeps u within the limits. Real-time.
  void limit(Eigen::VectorXd& u) const noexcept;
};

}  // namespace faultline

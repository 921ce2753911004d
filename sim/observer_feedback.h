#pragma once

#include <cstdint>

#include <Eigen/Core>

#include "sim/command_base.h"
#include "sim/control_design.h"
#include "sim/controller.h"
#include "sim/reference.h"

namespace faultline {

/// Output feedback by an observer on the sampled plant. The command given for y_k acts from k+1 on,
/// so the state is predicted to there (decision 0026):
///
///   x̂_k+1 = A x̂_k + B u_k + L (y_k - C x̂_k - D u_k)
///   command = clamp(u₀ + v + a sin(ω k) + N_u r - K (x̂_k+1 - N_x r)),  r = y_ref(k) - y₀
///
/// u_k is the command that acts at k: the one before, as it was sent, limits included, so that a
/// saturated actuator does not mislead the observer.
struct ObserverLaw {
  DiscretePlant plant;
  Eigen::MatrixXd K;    ///< m×n
  Eigen::MatrixXd L;    ///< n×q
  SteadyState target;   ///< of the outputs that have a reference
  CommandBase base;     ///< u₀ + v, ..
  Reference reference;  ///< absolute
  Eigen::VectorXd u_operating, y_operating;
};

/// ξ = (x̂, u acting).
[[nodiscard]] LinearController linear_form(const ObserverLaw& law);

/// An ObserverLaw at work. Over missing cycles it predicts with the last command, which the plant
/// holds meanwhile. It begins at x̂ = C⁺ (y - y₀ - D u), the smallest state that explains the
/// measurement; anew where k goes back (a plant that has restarted: u = 0, absolute, acts) or more
/// than kMaxMissingCycles ahead.
class ObserverFeedback final : public Controller {
 public:
  explicit ObserverFeedback(ObserverLaw law);
  void command(std::uint32_t k, std::span<const double> y, std::span<double> u) noexcept override;

  /// x̂ of the cycle after the last command, a deviation.
  [[nodiscard]] const Eigen::VectorXd& estimate() const noexcept { return x_; }

 private:
  void begin() noexcept;
  void predict() noexcept;
  void choose_command(std::uint32_t k) noexcept;

  ObserverLaw law_;
  Eigen::MatrixXd C_inverse_;
  bool has_begun_ = false;
  std::uint32_t k_ = 0;                           ///< of the last command
  Eigen::VectorXd x_, x_next_;                    ///< x̂
  Eigen::VectorXd u_, du_;                        ///< last command, absolute and as deviation
  Eigen::VectorXd dy_, innovation_, y_ref_, dx_;  ///< working space
};

}  // namespace faultline

#pragma once

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"
#include "sim/command_base.h"
#include "sim/controller.h"
#include "sim/reference.h"

namespace faultline {

/// State feedback on the measured state:
///
///   u_k = clamp(u₀ + v + a sin(ω k) - K C⁺ (y_k - y_ref(k)))
///
/// K m×n, C⁺ n×q the left inverse of C; the rest CommandBase and Reference. Without integral action
/// a reference is met only if v holds it.
struct ControlLaw {
  Eigen::MatrixXd gain;  ///< K C⁺, m×q
  CommandBase base;
  Reference reference;  ///< y₀ unless something else is asked for
};

/// @param K m×n feedback gain. @param feedforward v, m.
/// @throws std::invalid_argument C has no full column rank (the state cannot be read from y) or D ≠
/// 0.
[[nodiscard]] ControlLaw state_feedback(const PlantModel& model, const Eigen::MatrixXd& K,
                                        const Eigen::VectorXd& feedforward);

/// No feedback: u = u₀ + v.
[[nodiscard]] ControlLaw open_loop(const PlantModel& model, const Eigen::VectorXd& feedforward);

/// LQR gain for the plant sampled at sample_time_s; Q n×n, R m×m.
/// @throws std::invalid_argument as lqr_gain.
[[nodiscard]] Eigen::MatrixXd lqr_gain(const PlantModel& model, double sample_time_s,
                                       const Eigen::MatrixXd& Q, const Eigen::MatrixXd& R);

/// A ControlLaw at work.
class StaticFeedback final : public Controller {
 public:
  explicit StaticFeedback(ControlLaw law);
  void command(std::uint32_t k, std::span<const double> y, std::span<double> u) noexcept override;

 private:
  ControlLaw law_;
  Eigen::VectorXd dy_, y_ref_, u_;
};

}  // namespace faultline

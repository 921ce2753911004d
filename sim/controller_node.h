#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"
#include "drivers/can/can_bus.h"
#include "drivers/signal/message_integrity.h"
#include "drivers/signal/signal_map.h"
#include "sim/message_assembler.h"

namespace faultline {

/// State feedback on the measured state, with feed-forward and an excitation:
///
///   u_k = u₀ + v + a sin(ω k) - K C⁺ (y_k - y₀)
///
/// K m×n, C⁺ n×q the left inverse of C, v the feed-forward (m), a sin(ω k) channel by channel.
struct ControlLaw {
  Eigen::MatrixXd gain;         ///< K C⁺, m×q
  Eigen::VectorXd feedforward;  ///< u₀ + v, m
  Eigen::VectorXd y_operating;  ///< y₀, q
  Eigen::VectorXd amplitude;    ///< a, m
  Eigen::VectorXd omega_rad;    ///< ω, m: per cycle
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

/// The controller as a state machine on a bus: answers the measurement of cycle k with the commands
/// of counter k, with the alive counters and checksums that the map asks for. Owns no socket,
/// thread or clock.
class ControllerNode {
 public:
  /// `map` must outlive the node.
  ControllerNode(const SignalMap& map, ControlLaw law);

  /// Takes SYNC and sensor frames; sends commands when a measurement is complete. Real-time: does
  /// not allocate.
  void on_frame(const CanFrame& frame, FrameSink& sink) noexcept;

  /// Commands that did not fit their signals and were sent clamped.
  [[nodiscard]] std::uint64_t clamped_values() const noexcept { return clamped_values_; }

 private:
  void answer(std::uint32_t k, FrameSink& sink) noexcept;

  const SignalMap* map_;
  ControlLaw law_;
  MessageAssembler measurements_;
  std::vector<MessageProtector> protectors_;  // per command message
  std::uint32_t cycle_ = 0;
  Eigen::VectorXd dy_, u_;
  std::uint64_t clamped_values_ = 0;
};

}  // namespace faultline

#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace faultline {

/// From at_s on an output's reference goes to `value`, linearly within ramp_s (0: at once).
struct ReferenceStep {
  Eigen::Index output = 0;
  double at_s = 0.0;
  double value = 0.0;  ///< absolute
  double ramp_s = 0.0;
};

/// What the outputs are to be, over time. Absolute values. Without memory: a function of the cycle.
class Reference {
 public:
  /// Of no outputs.
  Reference() = default;
  /// @param start q values, which hold until steps change them. @param steps those of one output in
  /// order of time; one that begins during the ramp of another starts from where that has come to.
  /// @pre their outputs lie within `start`, sample_time_s > 0
  explicit Reference(Eigen::VectorXd start, std::vector<ReferenceStep> steps = {},
                     double sample_time_s = 1.0);

  /// y_ref of cycle k into y (q). Real-time: neither allocates nor throws.
  void at(std::uint32_t k, Eigen::VectorXd& y) const noexcept;

  [[nodiscard]] const Eigen::VectorXd& start() const noexcept { return start_; }
  [[nodiscard]] const std::vector<ReferenceStep>& steps() const noexcept { return steps_; }

 private:
  /// A line from (at_s, from) to (at_s + ramp_s, to), level afterwards.
  struct Piece {
    double at_s = 0.0, from = 0.0, to = 0.0, ramp_s = 0.0;
    [[nodiscard]] double value(double t_s) const noexcept;
  };

  Eigen::VectorXd start_;
  std::vector<ReferenceStep> steps_;
  std::vector<std::vector<Piece>> pieces_;  ///< per output, by time; empty where nothing changes
  double sample_time_s_ = 1.0;
};

}  // namespace faultline

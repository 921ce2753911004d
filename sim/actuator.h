#pragma once

#include <cstddef>
#include <limits>

#include "sim/fault.h"

namespace faultline {

/// A fault that acts in a cycle: entry i of a timeline with its activity a and its injected value.
struct ActingFault {
  std::size_t entry = 0;
  const Injection* injection = nullptr;
  double activity = 0.0;
  double value = 0.0;  ///< injected_value
};

/// One actuator: what it makes of the command u, cycle by cycle. Faults act in this order, whatever
/// the order of the timeline (u₀ is the operating point, z and w are left behind by the cycle
/// before, φ = exp(-T/τ)):
///
///   dead zone   v = u₀ + (u - u₀ ∓ width) beyond u₀ ± width, u₀ within; widths add up
///   lag         z_k = φ z_k-1 + (1 - φ) v_k, the exact answer of τ ż = v - z to a held command;
///               z begins where the actuator is, and what it lacks of v when the fault ends
///               fades with the same φ, so that the actuator never jumps of itself
///   gain        Γ z, factors multiply
///   offsets     + biases + sinusoids + drifts
///   hard-over   w + a·(p - w): goes to p over the ramp
///   stuck       at p, or where it was in the last cycle before (in the first cycle of all: where
///               it would be without)
///
/// Real-time: nothing here allocates or throws.
class Actuator {
 public:
  Actuator(double operating, double sample_time_s);

  /// The next cycle begins: nothing acts yet.
  void begin_cycle() noexcept;
  /// A fault acts in this cycle.
  void add(const ActingFault& fault) noexcept;
  [[nodiscard]] double respond(double command) noexcept;
  /// The same where no fault acts and none has left anything behind.
  void follow(double command) noexcept {
    last_ = previous_ = command;
    holder_ = kNone;
  }
  /// Whether it is slow, or still makes up for having been.
  [[nodiscard]] bool is_lagging() const noexcept { return lag_ != 0.0 || time_constant_s_ > 0.0; }

 private:
  [[nodiscard]] double lagged(double command) noexcept;

  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  static constexpr double kNothingYet = std::numeric_limits<double>::quiet_NaN();

  double operating_, sample_time_s_;
  double gain_ = 1.0, offset_ = 0.0, dead_zone_ = 0.0;
  double time_constant_s_ = 0.0;
  double fading_s_ = 0.0;                       // time constant with which lag_ fades
  double lag_ = 0.0;                            // z - v
  double previous_ = kNothingYet;               // v of the last cycle
  double hard_over_share_ = 0.0, place_ = 0.0;  // of the hard-over
  bool is_stuck_ = false;
  std::size_t holder_ = kNone;  // entry that holds held_
  double held_ = 0.0;
  double last_ = kNothingYet;  // what it did in the last cycle
};

}  // namespace faultline

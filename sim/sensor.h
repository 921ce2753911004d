#pragma once

#include <cstddef>
#include <limits>

#include "sim/actuator.h"
#include "sim/fault.h"

namespace faultline {

/// One sensor: what it makes of the measured y, cycle by cycle. Faults act in this order, whatever
/// the order of the timeline:
///
///   gain          Γ y, factors multiply
///   offsets       + biases + sinusoids + drifts
///   noise         + a σ ξ_k, ξ_k standard normal, of each entry its own
///   quantisation  to the nearest multiple of the (coarsest) step
///   stuck         at v, or at its last reading before (in the first cycle of all: at that one)
///   dropout       reads v, 0 without
///
/// Real-time: nothing here allocates or throws.
class Sensor {
 public:
  /// The next cycle begins: nothing acts yet.
  void begin_cycle() noexcept;
  /// A fault acts in this cycle. @param normal ξ_k of a noise, else not used
  void add(const ActingFault& fault, double normal) noexcept;
  [[nodiscard]] double read(double y) noexcept;
  /// The same where no fault acts.
  void follow(double y) noexcept {
    last_ = y;
    holder_ = kNone;
  }

 private:
  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

  double gain_ = 1.0, offset_ = 0.0, noise_ = 0.0, step_ = 0.0;
  bool is_stuck_ = false, is_dropped_out_ = false;
  double dropout_ = 0.0;
  std::size_t holder_ = kNone;  // entry that holds held_
  double held_ = 0.0;
  double last_ = std::numeric_limits<double>::quiet_NaN();  // last reading; NaN: none yet
};

}  // namespace faultline

#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/can/can_frame.h"

namespace faultline {

/// Nominal bit rate, and that of a CAN FD frame's data where its rate is switched; bit/s.
struct BitRates {
  double nominal = 500e3;
  double data = 2e6;
};

/// How much of each bus's time its frames take, by the exact length of each frame on the wire,
/// stuff bits and interframe space included. Repeated transmissions and error frames are not seen.
class BusLoad {
 public:
  struct Load {
    std::uint64_t frames = 0;
    double busy_s = 0.0;         ///< time on the wire
    double peak_second_s = 0.0;  ///< of the busiest second, counted from the first frame
  };

  explicit BusLoad(const BitRates& rates) : rates_(rates) {}

  void add(const CanFrame& frame);
  /// By index of the bus.
  [[nodiscard]] const std::vector<Load>& loads() const noexcept { return loads_; }
  /// Time from the first frame to the last, by their stamps; 0 before the second.
  [[nodiscard]] double span_s() const noexcept;

 private:
  BitRates rates_;
  std::vector<Load> loads_;
  std::vector<double> second_s_;              ///< busy time in the current second, by bus
  std::vector<std::int64_t> current_second_;  ///< by bus
  std::optional<Timestamp> first_, last_;
};

}  // namespace faultline

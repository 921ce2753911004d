#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/signal/message_watch.h"
#include "drivers/signal/sample.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// The values of one side (outputs or inputs) as a sample shows them: held where none came, with
/// age and state. A part of the sampler; does not allocate after construction.
class SampleValues {
 public:
  /// @param messages of this side. @param first_message index of their first in the SignalMap
  SampleValues(const std::vector<MappedMessage>& messages, std::size_t first_message,
               std::size_t channel_count);

  /// The next sample begins: all values are held, until they are taken.
  void begin() noexcept;
  /// Takes those of `values` that are `known`.
  void take(std::span<const double> values, std::span<const std::uint8_t> known) noexcept;
  /// Takes all of `values`, of which some are `fresh` and the others held by the caller.
  void assign(std::span<const double> values, std::span<const std::uint8_t> fresh) noexcept;
  /// All values are zero, and known.
  void take_zeros() noexcept;
  /// The values held are still those of this cycle.
  void keep_all() noexcept;
  /// The sample is complete: ages and states follow.
  void end(const MessageWatch& watch) noexcept;
  void reset() noexcept;

  [[nodiscard]] std::span<const double> values() const noexcept { return values_; }
  [[nodiscard]] std::span<const std::uint8_t> is_fresh() const noexcept { return is_fresh_; }
  [[nodiscard]] std::span<const std::uint32_t> age() const noexcept { return age_; }
  [[nodiscard]] std::span<const SignalState> state() const noexcept { return state_; }

 private:
  std::vector<std::size_t> message_of_;  ///< per channel: index in the SignalMap
  std::vector<double> values_;
  std::vector<std::uint8_t> is_fresh_;
  std::vector<std::uint32_t> age_;
  std::vector<SignalState> state_;
};

}  // namespace faultline

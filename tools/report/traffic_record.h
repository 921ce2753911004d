#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "drivers/dbc/dbc_database.h"
#include "drivers/signal/period_statistics.h"
#include "tools/bench/latency_histogram.h"
#include "tools/lcm/frame_message.h"

namespace faultline {

/// The frames of one identifier on one bus, in a log.
struct RecordedIdentifier {
  std::uint8_t bus = 0;
  std::uint32_t id = 0;
  bool is_extended = false;
  PeriodStatistics periods{};  ///< of the gaps between two frames
  LatencyHistogram gaps{};     ///< the same, counted
  Timestamp last{};            ///< when the last one came
};

/// What a log says of the frames on the bus: how many, and how regular.
class TrafficRecord {
 public:
  void add(const FrameBatch& batch);

  [[nodiscard]] std::vector<RecordedIdentifier> identifiers() const;
  [[nodiscard]] std::uint64_t frames() const noexcept { return frames_; }
  [[nodiscard]] std::uint64_t error_frames() const noexcept { return error_frames_; }
  [[nodiscard]] std::uint64_t malformed() const noexcept { return malformed_; }
  /// Frames of identifiers beyond the first kMostIdentifiers: only counted.
  [[nodiscard]] std::uint64_t uncounted() const noexcept { return uncounted_; }

  /// A babbling node can send any identifier there is.
  static constexpr std::size_t kMostIdentifiers = 256;

 private:
  std::map<std::tuple<std::uint8_t, bool, std::uint32_t>, RecordedIdentifier> identifiers_;
  std::uint64_t frames_ = 0, error_frames_ = 0, malformed_ = 0, uncounted_ = 0;
};

/// "Sensors1" where `dbc` has it, else "0x101".
[[nodiscard]] std::string message_name(const RecordedIdentifier& traffic, const DbcDatabase& dbc);

}  // namespace faultline

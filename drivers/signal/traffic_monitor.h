#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "drivers/can/can_frame.h"
#include "drivers/dbc/dbc_database.h"
#include "drivers/signal/message_integrity.h"
#include "drivers/signal/period_statistics.h"
#include "drivers/signal/signal_state.h"

namespace faultline {

/// All that was seen of one identifier on one bus.
struct IdentifierTraffic {
  static constexpr std::size_t kNoMessage = std::numeric_limits<std::size_t>::max();

  std::uint8_t bus = 0;
  std::uint32_t id = 0;
  bool is_extended = false;
  /// Index of its message in DbcDatabase::messages; kNoMessage if the DBC has none.
  std::size_t message = kNoMessage;

  std::uint64_t frames = 0;         ///< data and remote
  std::uint64_t remote_frames = 0;  ///< not checked, not timed
  std::uint64_t payload_bytes = 0;
  CanFrame last_frame;          ///< the newest data frame, whatever its check found
  IntegrityResult last_check;   ///< of `last_frame`
  PeriodStatistics period;      ///< of the data frames; has a period if the DBC gives one
  MessageIntegrity integrity;   ///< with the counters of the DBC message; else checks nothing
  Timestamp last_good_stamp{};  ///< of the newest frame that may be used (is_usable)
  bool has_good_frame = false;

  /// Data frames seen.
  [[nodiscard]] std::uint64_t data_frames() const noexcept { return frames - remote_frames; }
};

/// A message's values are stale when none came for so many of its periods.
inline constexpr int kStalePeriods = 3;

/// Time since the newest usable frame, at `now`; nothing before the first. Negative if `now` is
/// before it.
[[nodiscard]] std::optional<std::chrono::nanoseconds> age(const IdentifierTraffic& traffic,
                                                          Timestamp now) noexcept;

/// State at `now`: kNeverSeen before the first data frame;
/// kStale when the last data frame is more than kStalePeriods periods old (never without a period);
/// else what the last frame's check says: kCrcError (also a frame that was too short),
/// kCounterError (repeated, out of range, or a gap before it), kFresh.
[[nodiscard]] SignalState state(const IdentifierTraffic& traffic, Timestamp now) noexcept;

/// Follows every identifier on one or more buses: counts, times, checks. What `faultline can`
/// shows.
///
/// A frame belongs to the first message of the DBC with its identifier; where the DBC says on which
/// bus the message lives (FaultlineBus), on that bus only, else on every bus. Messages of the DBC
/// have an entry from the beginning, in the DBC's order, on the bus they live on or else bus 0;
/// other identifiers get theirs as they are seen. Error frames have none.
///
/// Memory is set aside at construction, and used as identifiers appear (less than 1 kB each): after
/// construction nothing allocates or throws. Use from one thread.
class TrafficMonitor {
 public:
  static constexpr std::size_t kMaxIdentifiers = 65536;

  /// Without a DBC: counts and times of every identifier.
  TrafficMonitor() : TrafficMonitor(DbcDatabase{}) {}
  /// Copies what it needs of `dbc`. @param max_identifiers entries beside those of the DBC
  /// @throws ProtectionError a message's protection or bus is described wrongly;
  ///   std::invalid_argument 2^32 or more identifiers.
  explicit TrafficMonitor(const DbcDatabase& dbc, std::size_t max_identifiers = kMaxIdentifiers);

  TrafficMonitor(TrafficMonitor&&) noexcept = default;
  TrafficMonitor& operator=(TrafficMonitor&&) noexcept = default;
  // A copy would not have the memory set aside.
  TrafficMonitor(const TrafficMonitor&) = delete;
  TrafficMonitor& operator=(const TrafficMonitor&) = delete;
  ~TrafficMonitor() = default;

  /// Takes one frame, in the order received.
  /// @return its entry, or nullptr: an error frame, or no room for another identifier. Valid as
  ///   long as the monitor.
  const IdentifierTraffic* on_frame(const CanFrame& frame) noexcept;

  /// Entry of an identifier, or nullptr.
  [[nodiscard]] const IdentifierTraffic* find(std::uint8_t bus, std::uint32_t id,
                                              bool is_extended) const noexcept;
  /// All entries: the DBC's messages first, in its order, then others as they appeared.
  [[nodiscard]] std::span<const IdentifierTraffic> identifiers() const noexcept { return entries_; }

  // Counters only grow.
  [[nodiscard]] std::uint64_t frames() const noexcept { return frames_; }  ///< of any kind
  [[nodiscard]] std::uint64_t error_frames() const noexcept { return error_frames_; }
  /// Frames of identifiers for which there was no room.
  [[nodiscard]] std::uint64_t untracked_frames() const noexcept { return untracked_frames_; }

 private:
  static constexpr std::uint32_t kNoPlace = std::numeric_limits<std::uint32_t>::max();
  /// The slot of `key`, or the free one where it would go.
  [[nodiscard]] std::size_t slot_of(std::uint64_t key) const noexcept;
  IdentifierTraffic* find_or_add(const CanFrame& frame) noexcept;
  IdentifierTraffic& add(std::uint64_t key, std::size_t slot) noexcept;

  std::vector<IdentifierTraffic> entries_;
  std::vector<std::uint64_t> keys_;    ///< open addressing; by slot: the identifier
  std::vector<std::uint32_t> places_;  ///< by slot: index in entries_ plus one; 0: free
  std::size_t max_entries_ = 0;
  std::vector<std::uint8_t> lives_on_one_bus_;  ///< per message of the DBC
  std::uint64_t frames_ = 0;
  std::uint64_t error_frames_ = 0;
  std::uint64_t untracked_frames_ = 0;
};

}  // namespace faultline

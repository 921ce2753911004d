#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

#include "drivers/can/can_frame.h"
#include "tools/bench/diagnosis_record.h"
#include "tools/bench/latency_histogram.h"
#include "tools/bench/realtime_sink.h"

namespace faultline {

/// What reading the steady clock costs on this machine: 25 ns on a host, 13.5 µs in User Mode Linux
/// (measured).
[[nodiscard]] std::chrono::nanoseconds steady_clock_cost() noexcept;

/// In one sample of how many the stages are timed, so that the clock reads of it stay below 1 % of
/// the period on average.
[[nodiscard]] std::uint32_t cycles_per_timed_sample(std::chrono::nanoseconds clock_cost,
                                                    std::chrono::nanoseconds period) noexcept;

/// Latencies of a run in real time, stage by stage (docs/decisions/0012). Filled by the publisher
/// from the times that came with the records: the diagnosis thread only reads its clock.
class StageLatencies {
 public:
  using SteadyTime = std::chrono::steady_clock::time_point;
  using Nanoseconds = std::chrono::nanoseconds;

  StageLatencies(Nanoseconds period, std::uint32_t cycles_per_value, bool has_probe);

  /// A cycle of the plant: how long after its deadline its frames were with the bus.
  void on_sent(Nanoseconds since_due) noexcept;
  /// A cycle that was not sent: it counts as sent with the next that is.
  void on_skipped() noexcept { ++skipped_; }
  /// @param published when its messages had been handed to the sinks; used if the sample was timed
  void on_record(const DiagnosisRecord& record, const StageTimes& times, SteadyTime published);
  /// The bare reader beside the diagnosis read the frame stamped `stamp`.
  void on_probe(Timestamp stamp, SteadyTime read) noexcept;
  /// No record follows.
  void finish() noexcept { settle(); }

  /// Kernel stamps are CLOCK_REALTIME, all other times steady: compares the two clocks. Call often,
  /// as the first is slewed.
  void compare_clocks() noexcept;

  /// Stages in the order of the way.
  [[nodiscard]] const std::vector<StageLatency>& stages() const noexcept { return stages_; }

 private:
  enum Stage : std::size_t {
    kDueSent,
    kStampRead,
    kReadDecoded,
    kDecodedStepped,
    kSteppedDecided,
    kDecidedQueued,
    kQueuedPublished,
    kTotal,
    kEndToEnd,
    kProbe,
  };
  /// The last sample so far: another may follow that the same frame closed.
  struct Waiting {
    bool is_any = false, is_timed = false;
    std::uint32_t cycle = 0;
    Timestamp stamp{};
    Nanoseconds to_read{}, to_queued{}, to_published{};
  };

  [[nodiscard]] LatencyHistogram& of(Stage stage) noexcept { return stages_[stage].histogram; }
  [[nodiscard]] Nanoseconds since(Timestamp stamp, SteadyTime time) const noexcept;
  void settle() noexcept;

  Nanoseconds period_;
  std::vector<StageLatency> stages_;
  Nanoseconds clock_offset_{};  ///< CLOCK_REALTIME - steady
  std::uint64_t skipped_ = 0;
  Waiting waiting_;
  bool has_settled_ = false;
  std::uint32_t settled_cycle_ = 0;
  Timestamp settled_stamp_{};
};

}  // namespace faultline

#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

#include "drivers/can/can_frame.h"
#include "tools/bench/diagnosis_record.h"
#include "tools/bench/slot_queue.h"

namespace faultline {

/// When one sample reached which stage, steady time.
struct StageTimes {
  using Time = std::chrono::steady_clock::time_point;
  Time read;  ///< of the batch with the frame that closed it
  Time decoded, stepped, decided, queued;
  bool is_closed_by_frame = false;  ///< else by the end of the run: there is nothing to time
  bool has_stages = false;          ///< decoded .. queued are set: in one sample of several
};

/// A record on its way to the publisher.
struct QueuedRecord {
  explicit QueuedRecord(const Bank& bank) : record(bank) {}
  DiagnosisRecord record;
  StageTimes times;
};

/// A frame and its place among those the diagnosis node received.
struct NumberedFrame {
  CanFrame frame;
  std::uint64_t number = 0;
};

/// Queues between the diagnosis thread and the publisher, and the thread's stop-watch: it turns the
/// node's stages into clock reads.
class RealtimeSink final : public DiagnosisSink {
 public:
  /// @param cycles_per_value stages are timed in one sample of so many
  RealtimeSink(const Bank& bank, std::size_t frame_slots, std::size_t record_slots,
               std::uint32_t cycles_per_value)
      : frames(frame_slots, NumberedFrame{}),
        records(record_slots, QueuedRecord(bank)),
        cycles_per_value_(cycles_per_value) {}

  // Diagnosis thread.

  /// Frames read at `read` follow.
  void begin_batch(StageTimes::Time read) noexcept {
    times_.read = read;
    times_.is_closed_by_frame = true;
  }
  /// No frames follow: what closes now was closed by the end of the run.
  void begin_end() noexcept { times_.is_closed_by_frame = false; }
  void on_received(const CanFrame& frame) noexcept override {
    frames.push({frame, frame_count_++});
  }
  void on_stage(DiagnosisStage stage) noexcept override;
  void on_record(const DiagnosisRecord& record) noexcept override;

  [[nodiscard]] std::uint64_t record_count() const noexcept { return record_count_; }

  // The publisher takes from these.
  SlotQueue<NumberedFrame> frames;
  SlotQueue<QueuedRecord> records;

 private:
  std::uint32_t cycles_per_value_;
  std::uint32_t until_timed_ = 0;  // samples
  StageTimes times_;
  std::uint64_t frame_count_ = 0;
  std::uint64_t record_count_ = 0;
};

}  // namespace faultline

#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/can/can_bus.h"
#include "drivers/signal/signal_map.h"
#include "sim/fault_schedule.h"
#include "sim/frame_queue.h"

namespace faultline {

/// Which node's frames.
enum class BenchNode { kPlant, kController };

/// What faults did to a node's frames. Counters only grow.
struct FrameFaultCounters {
  std::uint64_t dropped =
      0;  ///< never sent: dropped, of a node that is bus-off, or still held back
  std::uint64_t changed = 0;  ///< sent with other bytes than the node gave
  std::uint64_t late = 0;     ///< delayed or reordered
  std::uint64_t added = 0;    ///< duplicates and babble

  [[nodiscard]] bool is_clean() const noexcept { return dropped + changed + late + added == 0; }
};

[[nodiscard]] inline FrameFaultCounters operator+(const FrameFaultCounters& a,
                                                  const FrameFaultCounters& b) noexcept {
  return {.dropped = a.dropped + b.dropped,
          .changed = a.changed + b.changed,
          .late = a.late + b.late,
          .added = a.added + b.added};
}

/// What the faults of signals and frames do between a node and its bus: takes the node's frames and
/// passes them on, changed, late, several times or not at all. One object per node.
///
/// Several faults on one frame act in this order, those of one kind in that of the timeline:
///
///   1. its signals: frozen, offset, swapped, in the order of the timeline; the frame is protected
///      again: its alive counter stays, its checksum is right. Signals of two messages are swapped
///      within the cycle, for which the node's frames in between wait
///   2. its bytes: frozen counter (that of the frame before the fault), wrong CRC, corrupted bits,
///      wrong DLC
///   3. its way: dropped; else delayed (delays add up); then reordered, behind the next frame that
///      its node sends; its duplicates follow it at once
///
/// A delayed frame goes out in its cycle just before the frame of its message of that cycle, or at
/// the end of that cycle where there is none. Babble goes out at the beginning of the cycle, by the
/// node that sends the message of that identifier, else by the plant; its payload of 8 bytes is
/// drawn, and the other faults leave it alone. While a node is bus-off it sends nothing of all
/// that, and what would have been due is lost.
///
/// Neither allocates nor throws after construction. Costs one test per frame while nothing acts.
class FrameFaults final : public FrameSink {
 public:
  /// `map` and `schedule` must outlive this; entries may be added to the schedule meanwhile.
  FrameFaults(const SignalMap& map, const FaultSchedule& schedule, BenchNode node,
              double sample_time_s);

  /// Frames go to `out` from now on. Call before `begin_cycle`.
  void set_output(FrameSink& out) noexcept { out_ = &out; }
  /// Cycle k begins: cycles may be left out, but not come again.
  void begin_cycle(std::uint32_t k) noexcept;
  /// @return false if the bus refused a frame; true for one that a fault keeps back.
  bool send(const CanFrame& frame) noexcept override {
    return is_acting_ ? take(frame) : out_->send(frame);
  }
  /// Whether the node hears what is sent to it: not while it is bus-off.
  [[nodiscard]] bool hears() const noexcept { return !is_bus_off_; }

  /// Whether anything in the timeline so far, over or to come, may keep this node's frames or its
  /// hearing from it: who waits for their effect may wait in vain.
  [[nodiscard]] bool may_withhold() const noexcept { return may_withhold_; }
  /// Frames sent so far that no message of the map stands for: nobody on the bench listens to them.
  [[nodiscard]] std::uint64_t unheard() const noexcept { return unheard_; }
  [[nodiscard]] FrameFaultCounters counters() const noexcept;

  /// Most frames that one cycle can send to `out`, with one fault of each kind on every message.
  [[nodiscard]] std::size_t most_frames() const noexcept;

 private:
  /// An entry of the timeline that concerns this node.
  struct Entry {
    std::size_t index = 0;  ///< in the schedule
    InjectionKind kind = InjectionKind::kDropped;
    std::size_t message = 0;  ///< of the frame, or of the signal
    bool is_active = false;
    bool was_active = false;  ///< in the last frame that it could act on
    std::size_t v = 0;        ///< of kinds that count

    const MappedSignal* signal = nullptr;
    std::size_t with_message = 0;  ///< swapped
    const MappedSignal* with = nullptr;
    double frozen_value = 0.0;
    std::optional<std::uint64_t> frozen_count;

    // Babble
    CanFrame babble;
    bool is_heard = true;
  };

  void follow_schedule() noexcept;
  void add_entry(std::size_t index) noexcept;
  [[nodiscard]] bool find_signal(bool is_input, std::size_t channel, std::size_t& message,
                                 const MappedSignal*& signal) const noexcept;
  [[nodiscard]] bool set_babble(const FaultTarget& target, Entry& entry) const noexcept;
  [[nodiscard]] std::size_t count_of(const Entry& entry, std::size_t message) const noexcept;
  void babble() noexcept;

  bool take(const CanFrame& frame) noexcept;
  bool pass_waiting() noexcept;
  void change_signals() noexcept;
  void change_signal(Entry& entry) noexcept;
  void swap_signals(const Entry& entry) noexcept;
  [[nodiscard]] CanFrame* waiting_frame(std::size_t message) noexcept;
  void protect_waiting(std::size_t message) noexcept;
  void change_bytes(QueuedFrame& queued) noexcept;
  void change_by(Entry& entry, QueuedFrame& queued) noexcept;
  bool route(QueuedFrame& queued) noexcept;
  void release_due(std::size_t message) noexcept;
  bool pass(const QueuedFrame& queued) noexcept;
  bool put_out(const QueuedFrame& queued) noexcept;

  [[nodiscard]] bool is_mine(std::size_t message) const noexcept;
  [[nodiscard]] std::size_t message_of(const CanFrame& frame) const noexcept;

  const SignalMap* map_;
  const FaultSchedule* schedule_;
  BenchNode node_;
  double sample_time_s_;
  FrameSink* out_ = nullptr;

  std::vector<Entry> entries_;
  std::size_t followed_ = 0;  ///< entries of the schedule looked at so far
  bool may_withhold_ = false;
  bool is_acting_ = false;
  bool is_bus_off_ = false;
  std::uint32_t cycle_ = 0;
  double t_s_ = 0.0;

  std::vector<QueuedFrame> waiting_;  ///< for signals of a later frame of the cycle
  std::vector<std::uint8_t> is_waiting_changed_;
  FrameQueue delayed_;
  std::optional<QueuedFrame> behind_next_;
  std::uint64_t unheard_ = 0;
  FrameFaultCounters counters_;
};

}  // namespace faultline

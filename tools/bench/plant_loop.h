#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "drivers/can/can_bus.h"
#include "sim/frame_faults.h"
#include "sim/plant_node.h"
#include "tools/bench/bench.h"

namespace faultline {

/// A cycle as the plant lived it.
struct PlantCycle {
  PlantTruth truth{};
  Eigen::VectorXd x{};                   ///< absolute state at its start
  bool is_sent = true;                   ///< else it was late and OverrunPolicy::kSkip
  bool is_overrun = false;               ///< it began a whole period late or more
  std::chrono::nanoseconds since_due{};  ///< deadline to the frames with the bus
};

/// Whom a PlantLoop tells what happens, on its own thread.
class PlantLoopHost {
 public:
  virtual ~PlantLoopHost() = default;
  /// Asked at least every kIdleWait.
  [[nodiscard]] virtual bool must_stop() noexcept = 0;
  /// Cycle k begins: nothing of it has been sent.
  virtual void on_begin(std::uint32_t k) noexcept = 0;
  virtual void on_cycle(const PlantCycle& cycle) noexcept = 0;
  /// What came from the bus; with status kError nothing more will.
  virtual void on_received(const ReceiveResult& result, std::span<const CanFrame> frames) = 0;

 protected:
  PlantLoopHost() = default;
  PlantLoopHost(const PlantLoopHost&) = default;
  PlantLoopHost& operator=(const PlantLoopHost&) = default;
};

/// Leads the cycle in real time: cycle k begins at start + k·period, whatever became of those
/// before; in between the plant takes commands. The frames of a cycle go out in one call.
class PlantLoop {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// Longest wait on the bus before it asks whether it must stop.
  static constexpr std::chrono::milliseconds kIdleWait{20};

  /// All references must outlive the loop, which becomes the output of `faults`.
  /// @param most_frames that a cycle can send; more are not sent
  PlantLoop(PlantNode& plant, FrameFaults& faults, CanBus& bus, double sample_time_s,
            OverrunPolicy overrun, std::size_t most_frames);
  PlantLoop(const PlantLoop&) = delete;
  PlantLoop& operator=(const PlantLoop&) = delete;

  /// Cycles 0 .. count-1; fewer if the host stops it. Does not allocate but for a reason to stop.
  /// @return why it ended early: the plant diverged, or a cycle was late and OverrunPolicy::kStop
  std::optional<StopReason> run(Time start, std::uint32_t count, PlantLoopHost& host);
  void take_commands_until(Time deadline, PlantLoopHost& host);

  /// A cycle so far in the future that no thread has begun it before another one has added to the
  /// timeline what is to act from there on.
  [[nodiscard]] std::uint32_t free_cycle(Time start, Time now) const noexcept;

 private:
  /// Collects the frames of a cycle: they go out in one call, or not at all.
  class CycleFrames final : public FrameSink {
   public:
    explicit CycleFrames(std::size_t most) { frames_.reserve(most); }
    bool send(const CanFrame& frame) noexcept override {
      if (frames_.size() < frames_.capacity()) frames_.push_back(frame);
      return true;
    }
    [[nodiscard]] std::span<const CanFrame> frames() const noexcept { return frames_; }
    void clear() noexcept { frames_.clear(); }

   private:
    std::vector<CanFrame> frames_;
  };

  static constexpr std::size_t kBatch = 64;

  PlantNode& plant_;
  FrameFaults& faults_;
  CanBus& bus_;
  double sample_time_s_;
  std::chrono::nanoseconds period_;
  OverrunPolicy overrun_;
  CycleFrames frames_;
  std::array<CanFrame, kBatch> batch_{};
  PlantCycle cycle_;
};

}  // namespace faultline

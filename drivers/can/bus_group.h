#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "drivers/can/can_bus.h"

namespace faultline {

/// Several buses as one. A received frame carries the index of its bus in `bus`; a sent one goes to
/// the bus that its `bus` names (there being none is a send error). Members keep their order.
///
/// `receive` waits on all members at once, reads from each that is ready, none more than its share
/// of the batch as long as others have frames, and returns the frames in the order of their stamps.
/// It says kDown when the last member that was up goes down, once until one is back; the outages of
/// each are counted whatever the others do. It says kError only where no other member has frames.
class BusGroup final : public CanBus {
 public:
  /// Frames returned by one `receive` at most.
  static constexpr std::size_t kBatch = 256;
  /// As many as `CanFrame::bus` can tell apart.
  static constexpr std::size_t kMostMembers = 256;

  /// Allocates every buffer.
  /// @throws std::invalid_argument no member, more than kMostMembers, or one without a file
  ///   descriptor to wait on (an endpoint of a LoopBus).
  /// @throws BusError the system refuses.
  explicit BusGroup(std::vector<std::unique_ptr<CanBus>> members);
  ~BusGroup() override;
  BusGroup(const BusGroup&) = delete;
  BusGroup& operator=(const BusGroup&) = delete;

  bool send(const CanFrame& frame) noexcept override;
  std::size_t send_batch(std::span<const CanFrame> frames) noexcept override;
  ReceiveResult receive(std::span<CanFrame> out,
                        std::chrono::nanoseconds timeout) noexcept override;
  /// Sets them on every member.
  void set_filters(std::span<const IdFilter> filters) override;
  /// Readable when a member is.
  [[nodiscard]] int readiness_fd() const noexcept override;
  /// Of all members together, and frames sent to none.
  [[nodiscard]] BusCounters counters() const noexcept override;
  /// True if any member is up.
  [[nodiscard]] bool is_up() const noexcept override;
  /// Of the first member that was refused something.
  [[nodiscard]] int last_error() const noexcept override;
  /// The members' names with commas between them.
  [[nodiscard]] std::string name() const override;

  [[nodiscard]] std::size_t size() const noexcept;
  /// Counters and name of one. @pre index < size().
  [[nodiscard]] const CanBus& member(std::size_t index) const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline

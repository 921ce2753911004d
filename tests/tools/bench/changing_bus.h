#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "drivers/can/can_bus.h"
#include "tools/bench/bench_run.h"

namespace faultline {

/// What becomes of a frame: any number of frames.
using Change = std::function<void(const CanFrame& frame, std::deque<CanFrame>& out)>;

/// The diagnosis node's endpoint, behind a line that changes frames.
class ChangingBus final : public CanBus {
 public:
  ChangingBus(std::unique_ptr<CanBus> bus, Change change)
      : bus_(std::move(bus)), change_(std::move(change)) {}

  ReceiveResult receive(std::span<CanFrame> out,
                        std::chrono::nanoseconds timeout) noexcept override {
    while (waiting_.size() < out.size()) {
      const ReceiveResult received = bus_->receive(batch_, timeout);
      for (std::size_t i = 0; i < received.count; ++i) change_(batch_[i], waiting_);
      if (received.count < batch_.size()) break;
    }
    const std::size_t count = std::min(out.size(), waiting_.size());
    std::copy_n(waiting_.begin(), count, out.begin());
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(count));
    delivered_ += count;
    return {count > 0 ? ReceiveStatus::kOk : ReceiveStatus::kTimeout, count};
  }
  bool send(const CanFrame& frame) noexcept override { return bus_->send(frame); }
  void set_filters(std::span<const IdFilter> filters) override { bus_->set_filters(filters); }
  [[nodiscard]] int readiness_fd() const noexcept override { return bus_->readiness_fd(); }
  [[nodiscard]] BusCounters counters() const noexcept override {
    BusCounters counters = bus_->counters();
    counters.received = delivered_;
    return counters;
  }
  [[nodiscard]] std::string name() const override { return bus_->name(); }

 private:
  std::unique_ptr<CanBus> bus_;
  Change change_;
  std::array<CanFrame, 64> batch_{};
  std::deque<CanFrame> waiting_;
  std::atomic<std::uint64_t> delivered_{0};
};

/// Runs on the loop bus in lock-step, the diagnosis behind a line that changes frames.
inline BenchResult run_through(const BenchInputs& inputs, Change change,
                               const std::filesystem::path* log = nullptr) {
  BenchOptions options;
  options.bus = "loop";
  if (log != nullptr) options.log = *log;
  BenchRun run(inputs, options);
  run.buses.diagnosis =
      std::make_unique<ChangingBus>(std::move(run.buses.diagnosis), std::move(change));
  run_lock_step(run);
  return run.finish(run.utime_of(inputs.scenario.duration_s));
}

}  // namespace faultline

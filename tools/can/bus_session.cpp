#include "tools/can/bus_session.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <thread>

#include <fmt/format.h>

#include "drivers/can/open_bus.h"
#include "tools/bench/stop_signal.h"

namespace faultline {
namespace {

constexpr std::string_view kCanPrefix = "can:";

}  // namespace

BusSession::BusSession(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) {
    for (const std::string& one : split_bus_names(name)) {
      list += (list.empty() ? "" : ",") + one;
      short_names_.push_back(one.starts_with(kCanPrefix)
                                 ? one.substr(kCanPrefix.size())
                                 : fmt::format("udp{}", short_names_.size()));
      names_.push_back(one);
    }
  }
  bus_ = open_bus(list);
}

std::string_view BusSession::name_of(const CanFrame& frame) const noexcept {
  return frame.bus < short_names_.size() ? std::string_view(short_names_[frame.bus]) : "?";
}

void BusSession::report_status(ReceiveStatus status) {
  const bool is_down = status == ReceiveStatus::kDown;
  if (is_down && !is_down_) {
    fmt::print(stderr, "faultline: {} is down; waiting for its return\n", bus_->name());
  } else if (is_down_ && status == ReceiveStatus::kOk) {
    fmt::print(stderr, "faultline: {} is back\n", bus_->name());
  }
  if (is_down || status == ReceiveStatus::kOk) is_down_ = is_down;
  if (status == ReceiveStatus::kError) {
    throw BusError(fmt::format("{}: {}", bus_->name(), std::strerror(bus_->last_error())));
  }
}

std::chrono::duration<double> BusSession::listen(
    const SessionLimits& limits, const std::function<void(const CanFrame&)>& on_frame,
    const std::function<void()>& on_pause) {
  using Clock = std::chrono::steady_clock;
  constexpr double kForever_s = 1e9;
  StopSignal stop;
  std::array<CanFrame, 64> frames;
  std::uint64_t left = limits.frames.value_or(UINT64_MAX);
  const auto begin = Clock::now();
  const auto end =
      begin + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(
                  std::min(limits.seconds.value_or(kForever_s), kForever_s)));
  auto next_pause = begin + kPause;
  while (left > 0 && stop.poll() == 0) {
    const auto now = Clock::now();
    if (now >= end) break;
    const auto room = static_cast<std::size_t>(std::min<std::uint64_t>(frames.size(), left));
    const ReceiveResult result =
        bus_->receive({frames.data(), room}, std::min<std::chrono::nanoseconds>(end - now, kPause));
    report_status(result.status);
    for (std::size_t i = 0; i < result.count; ++i) on_frame(frames[i]);
    left -= result.count;
    if (result.count < room || Clock::now() >= next_pause) {
      on_pause();
      next_pause = Clock::now() + kPause;
    }
    // A bus that is down answers at once.
    if (result.status == ReceiveStatus::kDown) std::this_thread::sleep_for(kPause);
  }
  on_pause();
  return Clock::now() - begin;
}

}  // namespace faultline

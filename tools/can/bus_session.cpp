#include "tools/can/bus_session.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "drivers/can/open_bus.h"
#include "tools/bench/stop_signal.h"

namespace faultline {
namespace {

constexpr std::string_view kCanPrefix = "can:";

}  // namespace

std::vector<std::string> short_bus_names(std::string_view list) {
  std::vector<std::string> names;
  for (const std::string& name : split_bus_names(list)) {
    names.push_back(name.starts_with(kCanPrefix) ? name.substr(kCanPrefix.size())
                                                 : fmt::format("udp{}", names.size()));
  }
  return names;
}

std::string counters_text(const BusCounters& counters) {
  std::string text = fmt::format("received {}, dropped {}, malformed {}", counters.received,
                                 counters.dropped, counters.malformed);
  const auto add = [&](std::uint64_t count, const char* what) {
    if (count > 0) text += fmt::format(", {} {}", what, count);
  };
  add(counters.error_frames, "error frames");
  add(counters.bus_offs, "bus-off");
  add(counters.restarts, "restarts");
  add(counters.outages, "outages");
  return text;
}

BusSession::BusSession(const std::vector<std::string>& names) {
  const std::string list = fmt::format("{}", fmt::join(names, ","));
  names_ = split_bus_names(list);
  short_names_ = short_bus_names(list);
  bus_ = open_bus(list);
}

std::string_view BusSession::name_of(const CanFrame& frame) const noexcept {
  return frame.bus < short_names_.size() ? std::string_view(short_names_[frame.bus]) : "?";
}

void BusSession::report_outages() {
  if (bus_->is_up() == !is_down_) return;
  is_down_ = !is_down_;
  fmt::print(stderr, "faultline: {} is {}\n", bus_->name(),
             is_down_ ? "down; waiting for its return" : "back");
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
  auto last_frame = begin;
  while (left > 0 && stop.poll() == 0) {
    const auto now = Clock::now();
    if (now >= end) break;
    if (limits.idle_s && now - last_frame >= std::chrono::duration<double>(*limits.idle_s)) break;
    const auto room = static_cast<std::size_t>(std::min<std::uint64_t>(frames.size(), left));
    const ReceiveResult result =
        bus_->receive({frames.data(), room}, std::min<std::chrono::nanoseconds>(end - now, kPause));
    report_outages();
    if (result.status == ReceiveStatus::kError) {
      throw BusError(fmt::format("{}: {}", bus_->name(), std::strerror(bus_->last_error())));
    }
    for (std::size_t i = 0; i < result.count; ++i) on_frame(frames[i]);
    left -= result.count;
    if (result.count > 0) last_frame = now;
    if (result.count < room || Clock::now() >= next_pause) {
      on_pause();
      next_pause = Clock::now() + kPause;
    }
  }
  on_pause();
  if (const std::uint64_t drops = backlog_drops(); drops > 0) {
    fmt::print(stderr, "faultline: {}\n", backlog_drops_text(drops));
  }
  return Clock::now() - begin;
}

}  // namespace faultline

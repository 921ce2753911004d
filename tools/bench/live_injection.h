#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "sim/fault_schedule.h"
#include "sim/frame_faults.h"
#include "tools/lcm/lcm_source.h"

namespace faultline {

/// What becomes of a request to inject (INJECT).
struct InjectAnswer {
  bool is_accepted = false;
  /// "NAME: accepted: bias 2 on u2 from cycle 412 (4.12 s)", "NAME: refused: target: found .."
  std::string text;
};

/// Does what an encoded inject_t asks for, from `cycle` on, whose time is cycle·sample_time_s.
/// Everything in the message is from outside and not to be trusted.
/// @param node whose faults can be had here, where the other node is another process; nothing: all
[[nodiscard]] InjectAnswer answer_request(std::span<const std::uint8_t> message,
                                          FaultSchedule& schedule, std::uint32_t cycle,
                                          double sample_time_s,
                                          std::optional<BenchNode> node = std::nullopt);

/// Listens for INJECT on live LCM and adds to a run's timeline. A flood does not keep the run up:
/// more than kMostPerSecond requests within a second are counted and not looked at.
class LiveInjection {
 public:
  static constexpr int kMostPerSecond = 50;

  /// Told each answer, as an EVENT of source "inject" is to have it.
  using Tell = std::function<void(const char* severity, const std::string& text)>;

  /// @param url live LCM; @param schedule must outlive this
  /// @throws std::invalid_argument, MessageSourceError as LcmSource.
  LiveInjection(const std::string& url, FaultSchedule& schedule, double sample_time_s,
                std::optional<BenchNode> node = std::nullopt);

  /// Takes what has come, every few milliseconds only. Call often, on the thread that publishes.
  /// @param free_cycle no node has begun it, nor will have before this returns
  void attend(std::uint32_t free_cycle, const Tell& tell);

 private:
  using Clock = std::chrono::steady_clock;

  LcmSource source_;
  FaultSchedule& schedule_;
  double sample_time_s_;
  std::optional<BenchNode> node_;
  Clock::time_point next_look_{}, next_second_{};
  int taken_ = 0;  ///< in this second
  std::uint64_t passed_over_ = 0;
};

/// Whether anything can be listened for at `url`: not in a file.
[[nodiscard]] bool can_listen_to(const std::string& url) noexcept;

}  // namespace faultline

#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/can/can_frame.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// What a node misses, by the wall clock: says once that messages have ceased to come, and once
/// that they are back. No part of the diagnosis, which is a function of the frames.
class MessageSilence {
 public:
  using Time = std::chrono::steady_clock::time_point;

  struct Report {
    bool is_back = false;  ///< else they are missed
    std::string text;      ///< "no SYNC, Sensors1 for 0.52 s", "SYNC, Sensors1 back after 3.1 s"
  };

  /// @param messages that are listened for, by their index in `map`, which must outlive this. One
  ///   is missed when it has not come for 20 of its own periods (`period`, or several of them where
  ///   it is slower than the cycle), and for half a second at least.
  MessageSilence(const SignalMap& map, const std::vector<std::size_t>& messages,
                 std::chrono::nanoseconds period);

  /// A frame came. One thread, which may be another than that of `look`.
  void count(const CanFrame& frame) noexcept;
  /// @return what there is to say; nothing most of the time.
  [[nodiscard]] std::vector<Report> look(Time now);
  /// Whether something is missed, as of the last look.
  [[nodiscard]] bool is_any_missed() const noexcept;
  /// Times that something began to be missed.
  [[nodiscard]] std::uint64_t silences() const noexcept { return silences_; }

 private:
  struct Message {
    std::size_t index = 0;
    std::atomic<std::uint64_t> received{0};
    std::uint64_t seen = 0;  ///< of these, at the last look
    Time last{};             ///< when they were last seen to grow
    bool is_missed = false;
    std::chrono::nanoseconds limit{0};
  };

  const SignalMap* map_;
  std::vector<Message> messages_;
  bool is_begun_ = false;
  std::uint64_t silences_ = 0;
};

/// All messages of `map`, SYNC first.
[[nodiscard]] std::vector<std::size_t> all_messages(const SignalMap& map);
/// The messages of `map` that the plant sends (SYNC first), and those of the controller.
[[nodiscard]] std::vector<std::size_t> messages_of_plant(const SignalMap& map);
[[nodiscard]] std::vector<std::size_t> messages_of_controller(const SignalMap& map);

}  // namespace faultline

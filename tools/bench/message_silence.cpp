#include "tools/bench/message_silence.h"

#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

constexpr int kMissedPeriods = 20;
constexpr std::chrono::milliseconds kLeastLimit{500};

bool is_frame_of(const SignalMap& map, std::size_t message, const CanFrame& frame) noexcept {
  const std::size_t sensors = map.sensor_messages.size();
  const std::size_t commands = map.command_messages.size();
  if (message < sensors) return map.sensor_messages[message].matches(frame);
  if (message < sensors + commands) return map.command_messages[message - sensors].matches(frame);
  return map.sync->matches(frame);
}

}  // namespace

MessageSilence::MessageSilence(const SignalMap& map, const std::vector<std::size_t>& messages,
                               std::chrono::nanoseconds period)
    : map_(&map), messages_(messages.size()) {
  for (std::size_t i = 0; i < messages.size(); ++i) {
    const std::uint32_t cycles = messages[i] < map.sensor_messages.size()
                                     ? map.sensor_messages[messages[i]].cycles_per_frame
                                     : 1;
    messages_[i].index = messages[i];
    messages_[i].limit =
        std::max<std::chrono::nanoseconds>(kMissedPeriods * cycles * period, kLeastLimit);
  }
}

void MessageSilence::count(const CanFrame& frame) noexcept {
  for (Message& message : messages_) {
    if (!is_frame_of(*map_, message.index, frame)) continue;
    message.received.fetch_add(1, std::memory_order_relaxed);
    return;
  }
}

std::vector<MessageSilence::Report> MessageSilence::look(Time now) {
  if (!is_begun_) {
    is_begun_ = true;
    for (Message& message : messages_) message.last = now;
  }
  std::vector<std::string> missed, back;
  std::chrono::duration<double> missed_for{0}, away_for{0};
  for (Message& message : messages_) {
    const std::uint64_t received = message.received.load(std::memory_order_relaxed);
    const std::chrono::duration<double> silence = now - message.last;
    const bool has_come = received != message.seen;
    if (has_come && message.is_missed) {
      back.push_back(map_->message_name(message.index));
      away_for = std::max(away_for, silence);
    } else if (!has_come && !message.is_missed && silence > message.limit) {
      missed.push_back(map_->message_name(message.index));
      missed_for = std::max(missed_for, silence);
      message.is_missed = true;
    }
    if (!has_come) continue;
    message.seen = received;
    message.last = now;
    message.is_missed = false;
  }
  std::vector<Report> reports;
  if (!missed.empty()) {
    ++silences_;
    reports.push_back(
        {false, fmt::format("no {} for {:.2f} s", fmt::join(missed, ", "), missed_for.count())});
  }
  if (!back.empty()) {
    reports.push_back(
        {true, fmt::format("{} back after {:.2f} s", fmt::join(back, ", "), away_for.count())});
  }
  return reports;
}

bool MessageSilence::is_any_missed() const noexcept {
  return std::any_of(messages_.begin(), messages_.end(),
                     [](const Message& message) { return message.is_missed; });
}

std::vector<std::size_t> all_messages(const SignalMap& map) {
  std::vector<std::size_t> messages = messages_of_plant(map);
  const std::vector<std::size_t> commands = messages_of_controller(map);
  messages.insert(messages.end(), commands.begin(), commands.end());
  return messages;
}

std::vector<std::size_t> messages_of_plant(const SignalMap& map) {
  std::vector<std::size_t> messages;
  if (map.sync) messages.push_back(map.message_count() - 1);
  for (std::size_t i = 0; i < map.sensor_messages.size(); ++i) messages.push_back(i);
  return messages;
}

std::vector<std::size_t> messages_of_controller(const SignalMap& map) {
  std::vector<std::size_t> messages;
  for (std::size_t i = 0; i < map.command_messages.size(); ++i) {
    messages.push_back(map.sensor_messages.size() + i);
  }
  return messages;
}

}  // namespace faultline

#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "drivers/can/can_bus.h"
#include "drivers/can/input_backlog.h"

namespace faultline {

/// Longer than anything should take, also in a user-mode kernel.
inline constexpr std::chrono::seconds kPatience{5};
/// After a flood the kernel delivers what was sent a moment later than `send` returns: a bus on
/// which nothing has come for so long is quiet.
inline constexpr std::chrono::milliseconds kQuiet{50};

inline CanFrame frame_with(std::uint32_t id, std::uint8_t first_byte = 0) {
  CanFrame frame;
  frame.id = id;
  frame.length = 8;
  for (std::uint8_t n = 0; n < 8; ++n) frame.data[n] = static_cast<std::uint8_t>(first_byte + n);
  return frame;
}

inline CanFrame fd_frame_with(std::uint32_t id, std::uint8_t length) {
  CanFrame frame;
  frame.id = id;
  frame.is_fd = true;
  frame.length = length;
  for (std::uint8_t n = 0; n < length; ++n) frame.data[n] = static_cast<std::uint8_t>(0xFF - n);
  return frame;
}

/// A classic frame that carries its number.
inline CanFrame numbered_frame(std::uint32_t number) {
  CanFrame frame = frame_with(0x100);
  for (std::size_t n = 0; n < 4; ++n) frame.data[n] = static_cast<std::uint8_t>(number >> (8 * n));
  return frame;
}
inline std::uint32_t number_of(const CanFrame& frame) {
  std::uint32_t number = 0;
  for (std::size_t n = 4; n-- > 0;) number = number << 8 | frame.data[n];
  return number;
}

/// Reads until `count` frames are here, or kPatience is over without any.
inline std::vector<CanFrame> receive_frames(CanBus& bus, std::size_t count) {
  std::vector<CanFrame> frames;
  std::array<CanFrame, 64> batch;
  while (frames.size() < count) {
    const ReceiveResult result = bus.receive(batch, kPatience);
    if (result.status != ReceiveStatus::kOk) break;
    frames.insert(frames.end(), batch.begin(),
                  batch.begin() + static_cast<std::ptrdiff_t>(result.count));
  }
  return frames;
}

/// Reads until the bus is quiet.
inline std::vector<CanFrame> drain(CanBus& bus) {
  std::vector<CanFrame> frames;
  std::array<CanFrame, 64> batch;
  for (;;) {
    const ReceiveResult result = bus.receive(batch, kQuiet);
    if (result.status != ReceiveStatus::kOk) return frames;
    frames.insert(frames.end(), batch.begin(),
                  batch.begin() + static_cast<std::ptrdiff_t>(result.count));
  }
}

/// Holds that what was sent is accounted for: received, dropped by the reader's socket, or lost by
/// the kernel before the socket. The latter are the machine's, so that they may be more.
inline void expect_all_accounted(std::uint64_t sent, std::uint64_t received, std::uint64_t dropped,
                                 const InputBacklogWatch& backlog) {
  const std::uint64_t lost_before = backlog.drops();
  EXPECT_LE(received + dropped, sent);
  EXPECT_GE(received + dropped + lost_before, sent)
      << received << " received, " << dropped << " dropped, " << lost_before << " lost before";
}

/// Sends `count` frames at `rate_Hz` (0: as fast as it goes) while a reader that takes a pause now
/// and then reads them; then one more when it has read all, as the kernel tells of drops with the
/// next frame.
inline void flood(CanBus& sender, CanBus& reader, std::uint32_t count, double rate_Hz) {
  const InputBacklogWatch backlog;
  std::atomic<bool> is_over{false};
  std::uint64_t received = 0;
  std::thread slow([&] {
    std::array<CanFrame, 16> batch;
    for (;;) {
      const bool was_over = is_over;
      const ReceiveResult result = reader.receive(batch, kQuiet);
      received += result.count;
      if (result.count == 0 && was_over) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  });
  const auto begin = std::chrono::steady_clock::now();
  std::vector<CanFrame> burst;
  for (std::uint32_t n = 0; n < count;) {
    const auto elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin);
    const auto due = rate_Hz > 0.0
                         ? static_cast<std::uint32_t>(std::min(elapsed.count() * rate_Hz, 1e9))
                         : count;
    burst.clear();
    for (; n < std::min(due, count) && burst.size() < 64; ++n) burst.push_back(numbered_frame(n));
    if (burst.empty()) {
      std::this_thread::sleep_for(std::chrono::microseconds(500));
    } else {
      ASSERT_EQ(sender.send_batch(burst), burst.size());
    }
  }
  is_over = true;
  slow.join();
  ASSERT_TRUE(sender.send(numbered_frame(count)));
  received += receive_frames(reader, 1).size();
  EXPECT_EQ(sender.counters().sent, count + 1u);
  EXPECT_EQ(reader.counters().received, received);
  expect_all_accounted(sender.counters().sent, received, reader.counters().dropped, backlog);
  EXPECT_GT(reader.counters().dropped, 0u);
}

inline void run_command(const std::string& command) {
  ASSERT_EQ(std::system(command.c_str()), 0) << command;
}

/// A virtual CAN interface for as long as this object lives; down at first.
class TemporaryInterface {
 public:
  explicit TemporaryInterface(std::string interface_name = "vcantmp")
      : name(std::move(interface_name)) {
    add();
  }
  ~TemporaryInterface() {
    if (exists_) remove();
  }
  TemporaryInterface(const TemporaryInterface&) = delete;
  TemporaryInterface& operator=(const TemporaryInterface&) = delete;

  void add() {
    run_command("ip link add dev " + name + " type vcan");
    exists_ = true;
  }
  void set(const std::string& state) const { run_command("ip link set dev " + name + " " + state); }
  void remove() {
    run_command("ip link del dev " + name);
    exists_ = false;
  }

  const std::string name;

 private:
  bool exists_ = false;
};

}  // namespace faultline

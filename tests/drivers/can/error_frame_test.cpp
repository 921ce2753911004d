#include "drivers/can/error_frame.h"

#include <array>
#include <random>

#include <gtest/gtest.h>

#include "drivers/can/loop_bus.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;

CanFrame error_frame(std::uint32_t id, std::array<std::uint8_t, 8> data = {}) {
  CanFrame frame;
  frame.id = id;
  frame.is_error = true;
  frame.length = 8;
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

std::string text(std::uint32_t id, std::array<std::uint8_t, 8> data = {}) {
  return describe(read_error_frame(error_frame(id, data)));
}

TEST(ErrorFrame, TellsTheControllersState) {
  EXPECT_EQ(read_error_frame(error_frame(0x40)).state, ControllerState::kBusOff);
  EXPECT_EQ(read_error_frame(error_frame(0x4, {0, 0x40})).state, ControllerState::kErrorActive);
  for (const std::uint8_t warning : std::array<std::uint8_t, 3>{0x04, 0x08, 0x0C}) {
    EXPECT_EQ(read_error_frame(error_frame(0x4, {0, warning})).state,
              ControllerState::kErrorWarning);
  }
  for (const std::uint8_t passive : std::array<std::uint8_t, 4>{0x10, 0x20, 0x30, 0x3C}) {
    EXPECT_EQ(read_error_frame(error_frame(0x4, {0, passive})).state,
              ControllerState::kErrorPassive);
  }
  EXPECT_EQ(read_error_frame(error_frame(0x100)).state, ControllerState::kErrorActive);
  EXPECT_FALSE(read_error_frame(error_frame(0x20)).state.has_value());
  // Only a frame about the controller says something in that byte.
  EXPECT_FALSE(read_error_frame(error_frame(0x20, {0, 0x30})).state.has_value());
}

TEST(ErrorFrame, TellsTheErrorCountersWhereTheFrameHasThem) {
  const ErrorReport told = read_error_frame(error_frame(0x204, {0, 0x20, 0, 0, 0, 0, 128, 0}));
  EXPECT_EQ(told.transmit_errors, 128);
  EXPECT_EQ(told.receive_errors, 0);
  // Drivers before Linux 6.0 do not say that they tell them.
  EXPECT_EQ(read_error_frame(error_frame(0x4, {0, 0x10, 0, 0, 0, 0, 0, 130})).receive_errors, 130);
  EXPECT_FALSE(read_error_frame(error_frame(0x4, {0, 0x10})).receive_errors.has_value());
  EXPECT_FALSE(
      read_error_frame(error_frame(0x8, {0, 0, 0, 0, 0, 0, 5, 5})).transmit_errors.has_value());
}

TEST(ErrorFrame, ReadsAsASentence) {
  EXPECT_EQ(text(0x40), "bus-off");
  EXPECT_EQ(text(0x204, {0, 0x20, 0, 0, 0, 0, 128, 0}), "error-passive (tx 128, rx 0)");
  EXPECT_EQ(text(0x204, {0, 0x04, 0, 0, 0, 0, 0, 96}), "error-warning (tx 0, rx 96)");
  EXPECT_EQ(text(0x4, {0, 0x40}), "error-active");
  EXPECT_EQ(text(0x100), "restarted, error-active");
  EXPECT_EQ(text(0x20), "no acknowledgement");
  EXPECT_EQ(text(0x2), "arbitration lost");
  EXPECT_EQ(text(0x4, {0, 0x01}), "receive overflow in the controller");
  EXPECT_EQ(text(0x4, {0, 0x02}), "transmit overflow in the controller");
  EXPECT_EQ(text(0x88, {0, 0, 0x04}), "stuff error, bus error");
  EXPECT_EQ(text(0x8, {0, 0, 0x80}), "protocol error");
  EXPECT_EQ(text(0x8, {0, 0, 0x03}), "bit error, form error");
  EXPECT_EQ(text(0x1), "transmit timeout");
  EXPECT_EQ(text(0x10), "transceiver fault");
  EXPECT_EQ(text(0x80), "bus error");
  EXPECT_EQ(text(0), "unspecified error");
  EXPECT_EQ(text(0x400), "unspecified error");
}

TEST(ErrorFrame, SaysNothingOfAFrameThatIsNone) {
  CanFrame frame = error_frame(0x40);
  frame.is_error = false;
  EXPECT_FALSE(read_error_frame(frame).state.has_value());
}

TEST(ErrorFrame, CanBeReadWhateverItHolds) {
  std::mt19937_64 generator(5);
  for (int n = 0; n < 10'000; ++n) {
    CanFrame frame = error_frame(static_cast<std::uint32_t>(generator()) & kMaxExtendedId);
    frame.length = static_cast<std::uint8_t>(generator() % 9);
    for (std::size_t k = 0; k < frame.length; ++k) {
      frame.data[k] = static_cast<std::uint8_t>(generator());
    }
    EXPECT_NE(describe(read_error_frame(frame)), "");
  }
}

TEST(ErrorFrame, IsCountedByTheBusThatReceivesIt) {
  LoopBus bus;
  const auto sender = bus.attach();
  const auto receiver = bus.attach();
  for (const std::uint32_t id : {0x40u, 0x40u, 0x100u, 0x20u}) sender->send(error_frame(id));
  sender->send(CanFrame{});
  std::array<CanFrame, 8> out;
  ASSERT_EQ(receiver->receive(out, 0ns).count, 5u);
  EXPECT_EQ(receiver->counters().received, 5u);
  EXPECT_EQ(receiver->counters().error_frames, 4u);
  EXPECT_EQ(receiver->counters().bus_offs, 2u);
  EXPECT_EQ(receiver->counters().restarts, 1u);
  EXPECT_EQ(receiver->counters().outages, 0u);
}

}  // namespace
}  // namespace faultline

#include "sim/message_assembler.h"

#include <array>

#include <gtest/gtest.h>

#include "tests/sim/test_plants.h"

namespace faultline {
namespace {

class MessageAssemblerTest : public testing::Test {
 protected:
  CanFrame sensor(std::size_t message, std::uint32_t cycle, double y1, double y2) const {
    CanFrame frame;
    const std::array<double, 2> y{y1, y2};
    map_.sensor_messages[message].encode(y, cycle, frame);
    return frame;
  }
  SignalMap map_ = double_integrator_map();
  MessageAssembler assembler_{map_.sensor_messages, 2};
};

TEST_F(MessageAssemblerTest, CompletesACounterWithItsLastMessage) {
  EXPECT_FALSE(assembler_.push(sensor(0, 5, 1.0, 2.0), 5));
  const auto completed = assembler_.push(sensor(1, 5, 1.0, 2.0), 5);
  ASSERT_TRUE(completed);
  EXPECT_EQ(*completed, 5U);
  EXPECT_EQ(assembler_.values(5)[0], 1.0);
  EXPECT_EQ(assembler_.values(5)[1], 2.0);
}

TEST_F(MessageAssemblerTest, KeepsInterleavedCountersApart) {
  EXPECT_FALSE(assembler_.push(sensor(0, 5, 1.0, 0.0), 5));
  EXPECT_FALSE(assembler_.push(sensor(0, 6, 3.0, 0.0), 5));
  EXPECT_EQ(assembler_.push(sensor(1, 6, 0.0, 4.0), 5), 6U);
  EXPECT_EQ(assembler_.push(sensor(1, 5, 0.0, 2.0), 5), 5U);
  EXPECT_EQ(assembler_.values(5)[0], 1.0);
  EXPECT_EQ(assembler_.values(6)[1], 4.0);
}

TEST_F(MessageAssemblerTest, UnwrapsTheCounterNearTheNewestCycle) {
  const std::uint32_t k = 1'000'000;
  EXPECT_FALSE(assembler_.push(sensor(0, k + 1, 1.0, 0.0), k));
  EXPECT_EQ(assembler_.push(sensor(1, k + 1, 0.0, 1.0), k), k + 1);
  // Across the wrap of the 32-bit counter.
  EXPECT_FALSE(assembler_.push(sensor(0, 1, 1.0, 0.0), 0xFFFFFFFF));
  EXPECT_EQ(assembler_.push(sensor(1, 1, 0.0, 1.0), 0xFFFFFFFF), 1U);
}

TEST_F(MessageAssemblerTest, IgnoresRepeatsOthersAndShortPayloads) {
  EXPECT_FALSE(assembler_.push(sensor(0, 5, 1.0, 0.0), 5));
  EXPECT_FALSE(assembler_.push(sensor(0, 5, 9.0, 0.0), 5));
  CanFrame other = sensor(1, 5, 0.0, 2.0);
  other.id = 0x7FF;
  EXPECT_FALSE(assembler_.push(other, 5));
  CanFrame cut = sensor(1, 5, 0.0, 2.0);
  cut.length = 2;
  EXPECT_FALSE(assembler_.push(cut, 5));
  EXPECT_EQ(assembler_.push(sensor(1, 5, 0.0, 2.0), 5), 5U);
  EXPECT_EQ(assembler_.values(5)[0], 1.0);
}

// Message 1 comes in cycles 0, 3, 6, ..: elsewhere the other one completes the counter.
TEST_F(MessageAssemblerTest, WaitsForAMessageThatIsSlowerThanTheCycleOnlyWhereItIsDue) {
  map_.sensor_messages[1].cycles_per_frame = 3;
  MessageAssembler assembler(map_.sensor_messages, 2);
  for (std::uint32_t k = 0; k < 30; ++k) {
    const double now = k;
    const auto first = assembler.push(sensor(0, k, now, 0.0), k);
    if (k % 3 == 0) {
      EXPECT_FALSE(first) << k;
      EXPECT_EQ(assembler.push(sensor(1, k, 0.0, now), k), k);
    } else {
      EXPECT_EQ(first, k);
    }
    EXPECT_EQ(assembler.values(k)[0], now);
    EXPECT_EQ(assembler.values(k)[1], k - k % 3);
  }
}

TEST_F(MessageAssemblerTest, GoesOnWithoutAFrameThatIsLostOfASlowMessage) {
  map_.sensor_messages[1].cycles_per_frame = 3;
  MessageAssembler assembler(map_.sensor_messages, 2);
  for (std::uint32_t k = 0; k < 12; ++k) {
    const bool has_slow = k % 3 == 0 && k != 6;
    auto completed = assembler.push(sensor(0, k, k, 0.0), k);
    if (has_slow) completed = assembler.push(sensor(1, k, 0.0, k), k);
    EXPECT_EQ(completed.has_value(), k != 6) << k;
  }
  EXPECT_EQ(assembler.values(11)[1], 9.0);
}

TEST_F(MessageAssemblerTest, FindsASlowMessageAgainWhenItsUnitStartsAgain) {
  map_.sensor_messages[1].cycles_per_frame = 3;
  MessageAssembler assembler(map_.sensor_messages, 2);
  const auto cycle = [&](std::uint32_t k) {
    auto completed = assembler.push(sensor(0, k, k, 0.0), k);
    if (k % 3 == 0 && !completed)
      completed = assembler.push(sensor(1, k, 0.0, k), k);
    else if (k % 3 == 0)
      assembler.push(sensor(1, k, 0.0, k), k);
    return completed.has_value();
  };
  for (std::uint32_t k = 0; k < 50; ++k) ASSERT_TRUE(cycle(k));
  for (std::uint32_t k = 0; k < 50; ++k) EXPECT_TRUE(cycle(k)) << k;
}

TEST(MessageAssembler, RefusesWhatIsProtectedAndWrong) {
  const SignalMap map = protected_double_integrator_map();
  MessageAssembler assembler(map.command_messages, 1);
  MessageProtector protector(map.command_messages[0].protection);
  const auto command = [&](std::uint32_t counter, double force) {
    CanFrame frame;
    map.command_messages[0].encode(std::array<double, 1>{force}, counter, frame);
    protector.protect(frame);
    return frame;
  };
  const CanFrame first = command(0, 1.0);
  EXPECT_EQ(assembler.push(first, 0), 0U);
  CanFrame corrupted = command(1, 2.0);
  corrupted.data[0] ^= 1;
  EXPECT_FALSE(assembler.push(corrupted, 0));
  EXPECT_EQ(assembler.refused_frames(), 1U);
  EXPECT_EQ(assembler.push(command(2, 3.0), 1), 2U) << "the next good one counts";
  EXPECT_EQ(assembler.values(2)[0], 3.0);
}

}  // namespace
}  // namespace faultline

#include "tools/bench/live_injection.h"

#include <atomic>
#include <cmath>
#include <limits>
#include <random>
#include <thread>
#include <vector>

#include <faultline/inject_t.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr double kSampleTime_s = 0.01;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

FaultSchedule empty_schedule() {
  FaultTargets targets;
  targets.plant_name = "p";
  targets.inputs = {{.name = "u1", .range = 1.0}, {.name = "u2", .range = 1.0}};
  targets.outputs = {{.name = "y1", .range = 1.0}};
  targets.messages = {{.name = "Sensors", .length = 8},
                      {.name = "Commands", .is_command = true, .length = 8}};
  targets.sample_time_s = kSampleTime_s;
  return {targets, {}, 1};
}

inject_t request(const std::string& target, const std::string& kind) {
  inject_t message{};
  message.request = "r";
  message.target = target;
  message.kind = kind;
  message.has_value = 1;
  message.value = 2.0;
  message.probability = 1.0;
  return message;
}

std::vector<std::uint8_t> encoded(const inject_t& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

InjectAnswer answer(const inject_t& message, FaultSchedule& schedule, std::uint32_t cycle = 100,
                    std::optional<BenchNode> node = std::nullopt) {
  return answer_request(encoded(message), schedule, cycle, kSampleTime_s, node);
}

TEST(LiveInjection, ActsFromItsCycleUntilItIsCleared) {
  FaultSchedule schedule = empty_schedule();
  const InjectAnswer begin = answer(request("u2", "bias"), schedule, 100);
  EXPECT_TRUE(begin.is_accepted);
  EXPECT_EQ(begin.text, "r: accepted: bias 2 on u2 from cycle 100 (1 s)");
  ASSERT_EQ(schedule.size(), 1U);
  EXPECT_EQ(schedule.activity(0, 0.99), 0.0);
  EXPECT_EQ(schedule.activity(0, 1.00), 1.0);

  inject_t clear = request("u2", "");
  clear.clear = 1;
  EXPECT_EQ(answer(clear, schedule, 150).text,
            "r: accepted: 1 fault ends on u2 from cycle 150 (1.5 s)");
  EXPECT_EQ(schedule.activity(0, 1.49), 1.0);
  EXPECT_EQ(schedule.activity(0, 1.50), 0.0);
  EXPECT_THAT(answer(clear, schedule, 160).text, HasSubstr("no fault acts"));
}

TEST(LiveInjection, AnEndIsSnappedToACycleAndIsNotClearedAgain) {
  FaultSchedule schedule = empty_schedule();
  inject_t brief = request("u1", "bias");
  brief.duration_s = 0.0349;
  EXPECT_TRUE(answer(brief, schedule, 10).is_accepted);
  EXPECT_EQ(schedule.activity(0, 0.12), 1.0);
  EXPECT_EQ(schedule.activity(0, 0.13), 0.0);
  inject_t clear = request("u1", "");
  clear.clear = 1;
  EXPECT_FALSE(answer(clear, schedule, 20).is_accepted);
}

TEST(LiveInjection, RefusesWhatCannotBeAndSaysWhy) {
  FaultSchedule schedule = empty_schedule();
  const auto refused = [&](const inject_t& message) {
    const InjectAnswer got = answer(message, schedule);
    EXPECT_FALSE(got.is_accepted);
    EXPECT_LT(got.text.size(), 1000U);
    return got.text;
  };
  EXPECT_THAT(refused(request("u3", "bias")), HasSubstr("did you mean \"u"));
  EXPECT_THAT(refused(request("u1", "biass")), HasSubstr("did you mean \"bias\"?"));
  inject_t message = request("u1", "bias");
  message.value = kNaN;
  EXPECT_THAT(refused(message), HasSubstr("value: found nan"));
  message = request("u1", "bias");
  message.duration_s = -1.0;
  EXPECT_THAT(refused(message), HasSubstr("duration_s: found -1"));
  message = request("u1", "bias");
  message.probability = 0.0;
  EXPECT_THAT(refused(message), HasSubstr("probability"));
  message = request("u1", "bias");
  message.frequency_Hz = 1.0;
  EXPECT_THAT(refused(message), HasSubstr("frequency_Hz: found it with kind \"bias\""));
  EXPECT_THAT(refused(request(std::string(60000, 'x'), "bias")), HasSubstr("60000 bytes"));
  EXPECT_THAT(refused(request("u1\n\x1b[2J", "bias")), HasSubstr("found \"u1??[2J\""));
  message = request("u1", "bias");
  message.request = std::string(5000, 'r');
  EXPECT_THAT(refused(message), StartsWith(std::string(128, 'r') + ": refused: request:"));
  EXPECT_EQ(schedule.size(), 0U);
}

TEST(LiveInjection, ANodeTakesItsOwnFaultsOnly) {
  FaultSchedule schedule = empty_schedule();
  inject_t drop = request("Commands", "dropped");
  drop.has_value = 0;
  EXPECT_THAT(answer(drop, schedule, 1, BenchNode::kPlant).text,
              HasSubstr("which is for the controller"));
  EXPECT_TRUE(answer(drop, schedule, 1, BenchNode::kController).is_accepted);
  drop.target = "Sensors";
  EXPECT_TRUE(answer(drop, schedule, 1, BenchNode::kPlant).is_accepted);
  EXPECT_FALSE(answer(request("u1", "bias"), schedule, 1, BenchNode::kController).is_accepted);
  EXPECT_FALSE(answer(request("u1", "offset"), schedule, 1, BenchNode::kPlant).is_accepted);
}

TEST(LiveInjection, AFullTimelineRefuses) {
  FaultSchedule schedule = empty_schedule();
  for (std::size_t i = 0; i < FaultSchedule::kMostEntries; ++i) {
    ASSERT_TRUE(answer(request("u1", "bias"), schedule).is_accepted);
  }
  EXPECT_THAT(answer(request("u1", "bias"), schedule).text, HasSubstr("more than 256 faults"));
  EXPECT_EQ(schedule.size(), FaultSchedule::kMostEntries);
}

TEST(LiveInjection, BytesOfAnyKindAreRefusedOrSound) {
  FaultSchedule schedule = empty_schedule();
  const std::vector<std::uint8_t> whole = encoded(request("u1", "bias"));
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::vector<std::uint8_t> part(whole.begin(), whole.begin() + static_cast<long>(size));
    EXPECT_FALSE(answer_request(part, schedule, 1, kSampleTime_s).is_accepted) << size;
  }
  std::mt19937 random(1);
  for (int i = 0; i < 20000; ++i) {
    std::vector<std::uint8_t> damaged = whole;
    for (int n = 0; n < 3; ++n) {
      damaged[random() % damaged.size()] = static_cast<std::uint8_t>(random());
    }
    const InjectAnswer got = answer_request(damaged, schedule, 1, kSampleTime_s);
    EXPECT_LT(got.text.size(), 1000U);
  }
  for (std::size_t i = 0; i < schedule.size(); ++i) {
    EXPECT_TRUE(std::isfinite(schedule.value(i, 5.0)));
  }
}

// The timeline grows under readers that neither lock nor allocate.
TEST(LiveInjection, ReadersGoOnWhileTheTimelineGrows) {
  FaultSchedule schedule = empty_schedule();
  std::atomic<bool> is_over{false};
  std::atomic<std::uint64_t> heap_calls{0}, reads{0};
  std::thread reader([&] {
    std::size_t size = 0;
    double sum = 0.0;
    const AllocationGuard guard;
    while (!is_over || reads == 0) {
      const std::size_t now = schedule.size();
      if (now < size) break;
      size = now;
      for (std::size_t i = 0; i < size; ++i) sum += schedule.value(i, 2.0);
      ++reads;
    }
    heap_calls = guard.heap_calls() + (std::isfinite(sum) ? 0 : 1);
  });
  for (std::uint32_t k = 0; k < FaultSchedule::kMostEntries; ++k) {
    EXPECT_TRUE(answer(request(k % 2 == 0 ? "u1" : "u2", "bias"), schedule, k).is_accepted);
    if (k % 16 == 0) schedule.clear("u1", k * kSampleTime_s);
  }
  is_over = true;
  reader.join();
  EXPECT_EQ(heap_calls, 0U);
  EXPECT_GT(reads, 0U);
}

}  // namespace
}  // namespace faultline

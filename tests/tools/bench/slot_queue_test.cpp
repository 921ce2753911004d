#include "tools/bench/slot_queue.h"

#include <cstdint>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

TEST(SlotQueue, GivesValuesBackInOrder) {
  SlotQueue<int> queue(3, 0);
  EXPECT_EQ(queue.front(), nullptr);
  for (const int value : {1, 2, 3}) EXPECT_TRUE(queue.push(value));
  for (const int value : {1, 2, 3}) {
    ASSERT_NE(queue.front(), nullptr);
    EXPECT_EQ(*queue.front(), value);
    queue.pop();
  }
  EXPECT_EQ(queue.front(), nullptr);
}

TEST(SlotQueue, DropsAndCountsWhenItIsFull) {
  SlotQueue<int> queue(2, 0);
  EXPECT_TRUE(queue.push(1));
  EXPECT_TRUE(queue.push(2));
  EXPECT_FALSE(queue.push(3));
  EXPECT_FALSE(queue.push(4));
  EXPECT_EQ(queue.dropped(), 2U);
  EXPECT_EQ(*queue.front(), 1);
}

TEST(SlotQueue, DoesNotAllocateForValuesOfThePrototypesSize) {
  SlotQueue<std::vector<double>> queue(4, std::vector<double>(100));
  const std::vector<double> value(100, 1.5);
  const AllocationGuard guard;
  for (int i = 0; i < 1000; ++i) {
    queue.push(value);
    queue.pop();
  }
  EXPECT_EQ(guard.heap_calls(), 0U);
}

TEST(SlotQueue, LosesNothingUncountedBetweenTwoThreads) {
  constexpr std::uint64_t kCount = 200'000;
  SlotQueue<std::uint64_t> queue(64, 0);
  std::thread producer([&queue] {
    for (std::uint64_t i = 1; i <= kCount; ++i) queue.push(i);
    while (!queue.push(0)) std::this_thread::yield();
  });
  std::uint64_t received = 0;
  std::uint64_t last = 0;
  std::uint64_t out_of_order = 0;
  std::uint64_t end_tries_dropped = 0;
  for (;;) {
    const std::uint64_t* value = queue.front();
    if (value == nullptr) {
      std::this_thread::yield();
      continue;
    }
    if (*value == 0) break;
    if (*value <= last) ++out_of_order;
    last = *value;
    ++received;
    queue.pop();
  }
  producer.join();
  EXPECT_EQ(out_of_order, 0U);
  // Tries to push the end mark that found the queue full count as dropped, too.
  end_tries_dropped = received + queue.dropped() - kCount;
  EXPECT_GE(received + queue.dropped(), kCount);
  EXPECT_LE(end_tries_dropped, queue.dropped());
}

}  // namespace
}  // namespace faultline

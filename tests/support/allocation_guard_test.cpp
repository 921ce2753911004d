#include "tests/support/allocation_guard.h"

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace faultline {
namespace {

/// Keeps the compiler from leaving out an allocation whose result nobody uses.
void keep(void* memory) { asm volatile("" : : "r"(memory) : "memory"); }

TEST(AllocationGuard, CountsNewAndDelete) {
  const AllocationGuard guard;
  auto number = std::make_unique<int>(1);
  keep(number.get());
  number.reset();
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 2u);
}

TEST(AllocationGuard, CountsMallocAndFree) {
  const AllocationGuard guard;
  void* const memory = std::malloc(8);
  keep(memory);
  std::free(memory);
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 2u);
}

#ifndef __SANITIZE_THREAD__  // whose hooks, with g++ 12, leave these out
TEST(AllocationGuard, CountsTheRelativesOfMalloc) {
  const AllocationGuard guard;
  void* memory = std::calloc(2, 8);
  keep(memory);
  std::free(memory);
  memory = std::aligned_alloc(64, 64);
  keep(memory);
  std::free(memory);
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 4u);
}
#endif

TEST(AllocationGuard, CountsAGrowingVector) {
  std::vector<int> numbers(1);
  const AllocationGuard guard;
  numbers.resize(1000);
  keep(numbers.data());
  const auto calls = guard.heap_calls();
  EXPECT_GE(calls, 1u);
}

TEST(AllocationGuard, CountsNothingWhereNothingIsAllocated) {
  std::vector<int> numbers(1000);
  const AllocationGuard guard;
  for (int& number : numbers) number += 1;
  keep(numbers.data());
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
}

TEST(AllocationGuard, DoesNotCountOtherThreads) {
  std::atomic<int> stage{0};
  std::uint64_t calls = 1;
  std::thread counting([&] {
    const AllocationGuard guard;
    stage = 1;
    while (stage != 2) std::this_thread::yield();
    calls = guard.heap_calls();
  });
  while (stage != 1) std::this_thread::yield();
  void* const memory = std::malloc(8);
  keep(memory);
  std::free(memory);
  stage = 2;
  counting.join();
  EXPECT_EQ(calls, 0u);
}

}  // namespace
}  // namespace faultline

#pragma once

#include <cstdint>

namespace faultline {

/// Counts the calls the current thread makes to the heap (malloc, calloc, realloc, aligned
/// allocation, free, and so new and delete) while the guard lives. Other threads are not counted;
/// guards may nest.
///
///   AllocationGuard guard;
///   for (int step = 0; step < 1000; ++step) bank.step(...);
///   EXPECT_EQ(guard.heap_calls(), 0u);
///
/// Linking `faultline::test_support` replaces malloc in the test binary; built with a sanitizer,
/// the sanitizer's hooks count instead (g++ 12's thread sanitizer leaves calloc and aligned_alloc
/// out). No assertion of GoogleTest may stand in between: some
/// allocate.
class AllocationGuard {
 public:
  AllocationGuard() noexcept;
  /// Heap calls of this thread since construction.
  [[nodiscard]] std::uint64_t heap_calls() const noexcept;

 private:
  std::uint64_t calls_before_;
};

}  // namespace faultline

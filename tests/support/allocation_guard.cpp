#include "tests/support/allocation_guard.h"

#include <cerrno>
#include <cstddef>
#include <cstdlib>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define FAULTLINE_HAS_SANITIZER
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define FAULTLINE_HAS_SANITIZER
#endif

namespace faultline {
namespace {

constinit thread_local std::uint64_t heap_calls_of_thread = 0;

}  // namespace

AllocationGuard::AllocationGuard() noexcept : calls_before_(heap_calls_of_thread) {}

std::uint64_t AllocationGuard::heap_calls() const noexcept {
  return heap_calls_of_thread - calls_before_;
}

}  // namespace faultline

#ifdef FAULTLINE_HAS_SANITIZER

// A sanitizer owns malloc, and tells of every call through hooks.
// NOLINTNEXTLINE(bugprone-reserved-identifier)
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*malloc_hook)(const volatile void*,
                                                                             std::size_t),
                                                         void (*free_hook)(const volatile void*));

namespace faultline {
namespace {

[[maybe_unused]] const int kHooksInstalled = __sanitizer_install_malloc_and_free_hooks(
    [](const volatile void*, std::size_t) { ++heap_calls_of_thread; },
    [](const volatile void*) { ++heap_calls_of_thread; });

}  // namespace
}  // namespace faultline

#else

// glibc lets a program replace malloc and offers the original under these names (malloc/malloc.c).
// NOLINTBEGIN(bugprone-reserved-identifier, readability-inconsistent-declaration-parameter-name)
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);

void* malloc(std::size_t size) noexcept {
  ++faultline::heap_calls_of_thread;
  return __libc_malloc(size);
}

void* calloc(std::size_t count, std::size_t size) noexcept {
  ++faultline::heap_calls_of_thread;
  return __libc_calloc(count, size);
}

void* realloc(void* old, std::size_t size) noexcept {
  ++faultline::heap_calls_of_thread;
  return __libc_realloc(old, size);
}

void* memalign(std::size_t alignment, std::size_t size) noexcept {
  ++faultline::heap_calls_of_thread;
  return __libc_memalign(alignment, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  ++faultline::heap_calls_of_thread;
  return __libc_memalign(alignment, size);
}

int posix_memalign(void** out, std::size_t alignment, std::size_t size) noexcept {
  ++faultline::heap_calls_of_thread;
  *out = __libc_memalign(alignment, size);
  return *out == nullptr ? ENOMEM : 0;
}

void free(void* memory) noexcept {
  if (memory != nullptr) ++faultline::heap_calls_of_thread;
  __libc_free(memory);
}
}  // extern "C"
   // NOLINTEND(bugprone-reserved-identifier, readability-inconsistent-declaration-parameter-name)

#endif

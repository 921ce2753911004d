#include "tools/allocation_count.h"

#include <cstddef>
#include <cstdlib>
#include <new>

namespace faultline {
namespace {

constinit thread_local std::uint64_t calls_of_thread = 0;

void* allocate(std::size_t size, std::size_t alignment) {
  ++calls_of_thread;
  if (size == 0) size = 1;
  for (;;) {
    void* memory = nullptr;
    if (alignment <= __STDCPP_DEFAULT_NEW_ALIGNMENT__) {
      memory = std::malloc(size);
    } else if (::posix_memalign(&memory, alignment, size) != 0) {
      memory = nullptr;
    }
    if (memory != nullptr) return memory;
    const std::new_handler handler = std::get_new_handler();
    if (handler == nullptr) throw std::bad_alloc();
    handler();
  }
}

void release(void* memory) noexcept {
  if (memory != nullptr) ++calls_of_thread;
  std::free(memory);
}

}  // namespace

std::uint64_t thread_allocations() noexcept { return calls_of_thread; }

}  // namespace faultline

// Arrays end up in these, by the standard library's own definitions ([new.delete]); so would the
// nothrow forms, but for a sanitizer's, which allocate by themselves what we would then free.
void* operator new(std::size_t size) {
  return faultline::allocate(size, __STDCPP_DEFAULT_NEW_ALIGNMENT__);
}
void* operator new(std::size_t size, std::align_val_t alignment) {
  return faultline::allocate(size, static_cast<std::size_t>(alignment));
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  try {
    return ::operator new(size);
  } catch (const std::bad_alloc&) {
    return nullptr;
  }
}
void* operator new(std::size_t size, std::align_val_t alignment, const std::nothrow_t&) noexcept {
  try {
    return ::operator new(size, alignment);
  } catch (const std::bad_alloc&) {
    return nullptr;
  }
}
void operator delete(void* memory) noexcept { faultline::release(memory); }
void operator delete(void* memory, std::size_t) noexcept { faultline::release(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { faultline::release(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept {
  faultline::release(memory);
}

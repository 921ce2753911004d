#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace faultline {

/// Queue of fixed capacity between one producer and one consumer thread. Its slots are copies of a
/// prototype, made once: pushing assigns to a slot, so values that own sized buffers do not
/// allocate. A full queue drops and counts.
template <class T>
class SlotQueue {
 public:
  SlotQueue(std::size_t capacity, const T& prototype) : slots_(capacity + 1, prototype) {}

  /// Producer. @return false if the queue was full and `value` was dropped.
  bool push(const T& value) noexcept {
    T* const slot = free_slot();
    if (slot == nullptr) return false;
    *slot = value;
    push_slot();
    return true;
  }
  /// Producer: the slot to write the next value into, or nullptr if the queue was full, which
  /// counts as a dropped value. Nobody reads it before `push_slot`.
  [[nodiscard]] T* free_slot() noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (following(tail) == head_.load(std::memory_order_acquire)) {
      dropped_.fetch_add(1, std::memory_order_relaxed);
      return nullptr;
    }
    return &slots_[tail];
  }
  /// Producer: hands over what was written into `free_slot()`.
  void push_slot() noexcept {
    tail_.store(following(tail_.load(std::memory_order_relaxed)), std::memory_order_release);
  }

  /// Consumer: the oldest value, or nullptr. Valid until `pop`.
  [[nodiscard]] const T* front() const noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    return head == tail_.load(std::memory_order_acquire) ? nullptr : &slots_[head];
  }
  /// Consumer: gives the slot of `front()` back.
  void pop() noexcept {
    head_.store(following(head_.load(std::memory_order_relaxed)), std::memory_order_release);
  }

  /// Values dropped so far.
  [[nodiscard]] std::uint64_t dropped() const noexcept {
    return dropped_.load(std::memory_order_relaxed);
  }

 private:
  [[nodiscard]] std::size_t following(std::size_t index) const noexcept {
    return index + 1 == slots_.size() ? 0 : index + 1;
  }

  static constexpr std::size_t kCacheLine = 64;  // bytes, x86-64 and most Arm
  std::vector<T> slots_;
  alignas(kCacheLine) std::atomic<std::size_t> head_{0};
  alignas(kCacheLine) std::atomic<std::size_t> tail_{0};
  std::atomic<std::uint64_t> dropped_{0};
};

}  // namespace faultline

#include "drivers/can/loop_bus.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <mutex>
#include <stdexcept>
#include <utility>
#include <vector>

#include "drivers/can/atomic_bus_counters.h"
#include "drivers/can/id_filters.h"

namespace faultline {
namespace {

/// Longest single wait of `receive`: keeps the deadline's arithmetic far from overflow.
constexpr std::chrono::hours kLongestWait{24};

/// Size of what two threads must not share: the cache line of every CPU we build for.
constexpr std::size_t kCacheLine = 64;

/// Fixed ring of frames with one producer (whoever holds the hub's mutex) and one consumer.
class FrameRing {
 public:
  explicit FrameRing(std::size_t capacity) : capacity_(capacity), slots_(std::bit_ceil(capacity)) {}

  /// @return false if the ring is full.
  bool push(const CanFrame& frame) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_.load(std::memory_order_acquire) >= capacity_) return false;
    slots_[tail & (slots_.size() - 1)] = frame;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  /// Moves the oldest frames to the front of `out`. @return how many.
  std::size_t pop(std::span<CanFrame> out) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    const std::size_t available = tail_.load(std::memory_order_acquire) - head;
    const std::size_t count = std::min(available, out.size());
    if (count == 0) return 0;
    for (std::size_t n = 0; n < count; ++n) out[n] = slots_[(head + n) & (slots_.size() - 1)];
    head_.store(head + count, std::memory_order_release);
    return count;
  }

  [[nodiscard]] bool is_empty() const noexcept {
    return tail_.load(std::memory_order_acquire) == head_.load(std::memory_order_acquire);
  }

 private:
  alignas(kCacheLine) std::atomic<std::size_t> tail_{0};
  const std::size_t capacity_;
  std::vector<CanFrame> slots_;
  alignas(kCacheLine) std::atomic<std::size_t> head_{0};
};

}  // namespace

struct LoopBus::Hub {
  class Endpoint;

  explicit Hub(std::size_t capacity) : queue_capacity(capacity) {}

  /// Gives `frame` to every endpoint but `sender`.
  void deliver(const CanFrame& frame, const Endpoint& sender) noexcept;
  void detach(const Endpoint& endpoint) noexcept;

  const std::size_t queue_capacity;
  std::mutex mutex;  ///< orders the frames; guards what follows
  std::vector<Endpoint*> endpoints;
  bool is_time_virtual = false;
  Timestamp virtual_time{};
};

class LoopBus::Hub::Endpoint final : public CanBus {
 public:
  explicit Endpoint(std::shared_ptr<Hub> hub) : hub_(std::move(hub)), ring_(hub_->queue_capacity) {}
  ~Endpoint() override { hub_->detach(*this); }
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  bool send(const CanFrame& frame) noexcept override {
    if (!is_well_formed(frame)) {
      counters_.send_errors.add();
      return false;
    }
    hub_->deliver(frame, *this);
    counters_.sent.add();
    return true;
  }

  ReceiveResult receive(std::span<CanFrame> out,
                        std::chrono::nanoseconds timeout) noexcept override {
    if (out.empty()) return {};
    std::size_t count = ring_.pop(out);
    if (count == 0 && timeout > std::chrono::nanoseconds::zero() && wait_for_frame(timeout)) {
      count = ring_.pop(out);
    }
    if (count == 0) return {};
    counters_.count_received(out.first(count));
    return {ReceiveStatus::kOk, count};
  }

  void set_filters(std::span<const IdFilter> filters) override {
    IdFilters wanted(filters);
    const std::lock_guard lock(hub_->mutex);
    filters_ = std::move(wanted);
  }

  [[nodiscard]] int readiness_fd() const noexcept override { return -1; }
  [[nodiscard]] BusCounters counters() const noexcept override { return counters_.snapshot(); }
  [[nodiscard]] std::string name() const override { return "loop"; }

  /// Queues `frame` if the filters let it pass. @pre the hub's mutex is held.
  void accept(const CanFrame& frame) noexcept {
    if (!filters_.pass(frame)) return;
    if (!ring_.push(frame)) {
      counters_.dropped.add();
      return;
    }
    if (is_waiting_) frame_arrived_.notify_one();
  }

 private:
  /// @return false if `timeout` passed without a frame.
  bool wait_for_frame(std::chrono::nanoseconds timeout) noexcept {
    const auto deadline = std::chrono::steady_clock::now() +
                          std::min<std::chrono::nanoseconds>(timeout, kLongestWait);
    std::unique_lock lock(hub_->mutex);
    is_waiting_ = true;
    const bool arrived =
        frame_arrived_.wait_until(lock, deadline, [this] { return !ring_.is_empty(); });
    is_waiting_ = false;
    return arrived;
  }

  std::shared_ptr<Hub> hub_;
  FrameRing ring_;
  AtomicBusCounters counters_;
  // Guarded by the hub's mutex.
  IdFilters filters_;
  bool is_waiting_ = false;
  std::condition_variable frame_arrived_;
};

void LoopBus::Hub::deliver(const CanFrame& frame, const Endpoint& sender) noexcept {
  CanFrame delivered = frame;
  const std::size_t length = frame.is_remote ? 0 : frame.length;
  std::memset(delivered.data.data() + length, 0, kMaxPayload - length);
  const std::lock_guard lock(mutex);
  delivered.stamp = is_time_virtual ? virtual_time : std::chrono::system_clock::now();
  for (Endpoint* endpoint : endpoints) {
    if (endpoint != &sender) endpoint->accept(delivered);
  }
}

void LoopBus::Hub::detach(const Endpoint& endpoint) noexcept {
  const std::lock_guard lock(mutex);
  std::erase(endpoints, &endpoint);
}

LoopBus::LoopBus(std::size_t queue_capacity) {
  if (queue_capacity == 0) {
    throw std::invalid_argument("LoopBus: queue_capacity is 0, expected at least 1");
  }
  hub_ = std::make_shared<Hub>(queue_capacity);
}

LoopBus::~LoopBus() = default;

std::unique_ptr<CanBus> LoopBus::attach() {
  auto endpoint = std::make_unique<Hub::Endpoint>(hub_);
  const std::lock_guard lock(hub_->mutex);
  hub_->endpoints.push_back(endpoint.get());
  return endpoint;
}

void LoopBus::set_time(Timestamp now) noexcept {
  const std::lock_guard lock(hub_->mutex);
  hub_->is_time_virtual = true;
  hub_->virtual_time = now;
}

}  // namespace faultline

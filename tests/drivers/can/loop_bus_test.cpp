#include "drivers/can/loop_bus.h"

#include <array>
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;

CanFrame frame_with(std::uint32_t id, std::uint8_t first_byte = 0) {
  CanFrame frame;
  frame.id = id;
  frame.length = 8;
  frame.data[0] = first_byte;
  return frame;
}

std::vector<CanFrame> receive_all(CanBus& bus) {
  std::vector<CanFrame> frames;
  std::array<CanFrame, 16> batch;
  for (;;) {
    const ReceiveResult result = bus.receive(batch, 0ns);
    if (result.status != ReceiveStatus::kOk) return frames;
    frames.insert(frames.end(), batch.begin(),
                  batch.begin() + static_cast<std::ptrdiff_t>(result.count));
  }
}

TEST(LoopBus, DeliversToEveryOtherEndpointAndNeverToTheSender) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  const auto c = bus.attach();
  EXPECT_TRUE(a->send(frame_with(0x123, 7)));
  ASSERT_EQ(receive_all(*b).size(), 1u);
  const auto at_c = receive_all(*c);
  ASSERT_EQ(at_c.size(), 1u);
  EXPECT_TRUE(same_on_wire(at_c[0], frame_with(0x123, 7)));
  EXPECT_TRUE(receive_all(*a).empty());
}

TEST(LoopBus, CarriesFdFramesWithAllTheirFlags) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  CanFrame frame;
  frame.id = 0x1ABC'DEF0;
  frame.is_extended = true;
  frame.is_fd = true;
  frame.is_bit_rate_switched = true;
  frame.is_error_state = true;
  frame.length = 64;
  for (std::size_t n = 0; n < kMaxPayload; ++n) frame.data[n] = static_cast<std::uint8_t>(n + 1);
  ASSERT_TRUE(a->send(frame));
  const auto received = receive_all(*b);
  ASSERT_EQ(received.size(), 1u);
  EXPECT_TRUE(same_on_wire(received[0], frame));
}

TEST(LoopBus, KeepsTheTagOfTheBusAsSent) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  CanFrame frame = frame_with(1);
  frame.bus = 3;
  ASSERT_TRUE(a->send(frame));
  const auto received = receive_all(*b);
  ASSERT_EQ(received.size(), 1u);
  EXPECT_EQ(received[0].bus, 3);
}

TEST(LoopBus, DeliversZeroBeyondThePayload) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  CanFrame frame = frame_with(1);
  frame.length = 3;
  frame.data.fill(0xAA);
  ASSERT_TRUE(a->send(frame));
  const auto received = receive_all(*b);
  ASSERT_EQ(received.size(), 1u);
  for (std::size_t n = 0; n < kMaxPayload; ++n) {
    EXPECT_EQ(received[0].data[n], n < 3 ? 0xAA : 0x00) << "byte " << n;
  }
}

TEST(LoopBus, RefusesMalformedFramesAndCountsThem) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  CanFrame too_long = frame_with(1);
  too_long.length = 9;
  EXPECT_FALSE(a->send(too_long));
  EXPECT_FALSE(a->send(frame_with(0x800)));
  EXPECT_EQ(a->counters().send_errors, 2u);
  EXPECT_EQ(a->counters().sent, 0u);
  EXPECT_TRUE(receive_all(*b).empty());
}

TEST(LoopBus, DropsAtAFullQueueAndCountsExactly) {
  LoopBus bus(5);
  const auto a = bus.attach();
  const auto slow = bus.attach();
  for (std::uint8_t n = 0; n < 12; ++n) EXPECT_TRUE(a->send(frame_with(1, n)));
  const auto received = receive_all(*slow);
  ASSERT_EQ(received.size(), 5u);
  for (std::size_t n = 0; n < 5; ++n) EXPECT_EQ(received[n].data[0], n);  // the oldest are kept
  EXPECT_EQ(slow->counters().dropped, 7u);
  EXPECT_EQ(slow->counters().received, 5u);
  EXPECT_EQ(a->counters().sent, 12u);
  EXPECT_EQ(a->counters().dropped, 0u);
}

TEST(LoopBus, GoesOnAfterAFullQueueWasRead) {
  LoopBus bus(2);
  const auto a = bus.attach();
  const auto b = bus.attach();
  for (int round = 0; round < 10; ++round) {
    for (std::uint8_t n = 0; n < 3; ++n) a->send(frame_with(1, n));
    EXPECT_EQ(receive_all(*b).size(), 2u);
  }
  EXPECT_EQ(b->counters().dropped, 10u);
}

TEST(LoopBus, ReturnsAtMostWhatTheSpanHolds) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  for (std::uint8_t n = 0; n < 5; ++n) a->send(frame_with(1, n));
  std::array<CanFrame, 3> out;
  EXPECT_EQ(b->receive(out, 0ns).count, 3u);
  EXPECT_EQ(out[2].data[0], 2);
  EXPECT_EQ(b->receive(out, 0ns).count, 2u);
  EXPECT_EQ(out[0].data[0], 3);
}

TEST(LoopBus, ReturnsAtOnceWithoutTimeout) {
  LoopBus bus;
  const auto a = bus.attach();
  std::array<CanFrame, 1> out;
  const ReceiveResult result = a->receive(out, 0ns);
  EXPECT_EQ(result.status, ReceiveStatus::kTimeout);
  EXPECT_EQ(result.count, 0u);
  EXPECT_EQ(a->receive(out, -1s).status, ReceiveStatus::kTimeout);
  EXPECT_EQ(a->receive({}, 1h).status, ReceiveStatus::kTimeout);
}

TEST(LoopBus, WaitsForTheWholeTimeout) {
  LoopBus bus;
  const auto a = bus.attach();
  std::array<CanFrame, 1> out;
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(a->receive(out, 20ms).status, ReceiveStatus::kTimeout);
  EXPECT_GE(std::chrono::steady_clock::now() - begin, 20ms);
}

TEST(LoopBus, WakesAWaitingReceiver) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  std::thread sender([&] {
    std::this_thread::sleep_for(10ms);
    a->send(frame_with(5));
  });
  std::array<CanFrame, 1> out;
  const ReceiveResult result = b->receive(out, std::chrono::nanoseconds::max());
  sender.join();
  EXPECT_EQ(result.status, ReceiveStatus::kOk);
  EXPECT_EQ(out[0].id, 5u);
}

TEST(LoopBus, FiltersByIdentifierAndFormat) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  const std::array<IdFilter, 2> filters{{{0x10, false}, {0x20, true}}};
  b->set_filters(filters);
  CanFrame extended = frame_with(0x20);
  extended.is_extended = true;
  a->send(frame_with(0x10));
  a->send(frame_with(0x20));  // the same number, but 11 bits
  a->send(extended);
  a->send(frame_with(0x11));
  const auto received = receive_all(*b);
  ASSERT_EQ(received.size(), 2u);
  EXPECT_EQ(received[0].id, 0x10u);
  EXPECT_TRUE(received[1].is_extended);
  EXPECT_EQ(b->counters().dropped, 0u);
  b->set_filters({});
  a->send(frame_with(0x11));
  EXPECT_EQ(receive_all(*b).size(), 1u);
}

TEST(LoopBus, LetsErrorFramesPassEveryFilter) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  const std::array<IdFilter, 1> filters{{{0x10, false}}};
  b->set_filters(filters);
  CanFrame error = frame_with(0x4);
  error.is_error = true;
  a->send(error);
  EXPECT_EQ(receive_all(*b).size(), 1u);
}

TEST(LoopBus, StampsWithTheVirtualTime) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  bus.set_time(Timestamp(123ns));
  a->send(frame_with(1));
  bus.set_time(Timestamp(456ns));
  a->send(frame_with(2));
  const auto received = receive_all(*b);
  ASSERT_EQ(received.size(), 2u);
  EXPECT_EQ(received[0].stamp, Timestamp(123ns));
  EXPECT_EQ(received[1].stamp, Timestamp(456ns));
}

TEST(LoopBus, StampsWithTheSystemClockOtherwise) {
  LoopBus bus;
  const auto a = bus.attach();
  const auto b = bus.attach();
  const Timestamp before = std::chrono::system_clock::now();
  a->send(frame_with(1));
  const Timestamp after = std::chrono::system_clock::now();
  const auto received = receive_all(*b);
  ASSERT_EQ(received.size(), 1u);
  EXPECT_GE(received[0].stamp, before);
  EXPECT_LE(received[0].stamp, after);
}

TEST(LoopBus, OutlivesItsHandleAndDetachedEndpoints) {
  std::unique_ptr<CanBus> a;
  std::unique_ptr<CanBus> b;
  {
    LoopBus bus;
    a = bus.attach();
    b = bus.attach();
    const auto gone = bus.attach();
  }
  EXPECT_TRUE(a->send(frame_with(1)));
  EXPECT_EQ(receive_all(*b).size(), 1u);
}

TEST(LoopBus, SaysItsNameAndHasNoDescriptor) {
  LoopBus bus;
  const auto a = bus.attach();
  EXPECT_EQ(a->name(), "loop");
  EXPECT_EQ(a->readiness_fd(), -1);
  EXPECT_EQ(a->last_error(), 0);
}

TEST(LoopBus, RefusesAQueueWithoutRoom) { EXPECT_THROW(LoopBus(0), std::invalid_argument); }

TEST(LoopBus, ShowsAllEndpointsOneOrderWhenSeveralThreadsSend) {
  constexpr std::size_t kSenders = 3;
  constexpr std::size_t kFramesEach = 3000;
  LoopBus bus(kSenders * kFramesEach);
  std::vector<std::unique_ptr<CanBus>> senders;
  for (std::size_t n = 0; n < kSenders; ++n) senders.push_back(bus.attach());
  const auto a = bus.attach();
  const auto b = bus.attach();
  std::vector<std::thread> threads;
  for (std::size_t n = 0; n < kSenders; ++n) {
    threads.emplace_back([&, n] {
      for (std::size_t k = 0; k < kFramesEach; ++k) {
        CanFrame frame = frame_with(static_cast<std::uint32_t>(n));
        frame.data[1] = static_cast<std::uint8_t>(k & 0xFF);
        frame.data[2] = static_cast<std::uint8_t>(k >> 8);
        senders[n]->send(frame);
      }
    });
  }
  const auto collect = [](CanBus& endpoint) {
    std::vector<CanFrame> frames;
    std::array<CanFrame, 64> batch;
    while (frames.size() < kSenders * kFramesEach) {
      const ReceiveResult result = endpoint.receive(batch, 5s);
      if (result.status != ReceiveStatus::kOk) break;
      frames.insert(frames.end(), batch.begin(),
                    batch.begin() + static_cast<std::ptrdiff_t>(result.count));
    }
    return frames;
  };
  std::vector<CanFrame> at_b;
  std::thread reader([&] { at_b = collect(*b); });
  const std::vector<CanFrame> at_a = collect(*a);
  reader.join();
  for (std::thread& thread : threads) thread.join();
  ASSERT_EQ(at_a.size(), kSenders * kFramesEach);
  ASSERT_EQ(at_b.size(), at_a.size());
  std::size_t differing = 0;
  for (std::size_t n = 0; n < at_a.size(); ++n)
    differing += same_on_wire(at_a[n], at_b[n]) ? 0u : 1u;
  EXPECT_EQ(differing, 0u);
}

TEST(LoopBus, DoesNotAllocateAfterAttaching) {
  LoopBus bus(64);
  const auto a = bus.attach();
  const auto b = bus.attach();
  const std::array<IdFilter, 2> filters{{{0x10, false}, {0x20, true}}};
  b->set_filters(filters);
  const CanFrame frame = frame_with(0x10);
  std::array<CanFrame, 8> out;
  std::size_t received = 0;
  const AllocationGuard guard;
  for (int step = 0; step < 1000; ++step) {
    a->send(frame);
    a->send(frame);
    received += b->receive(out, 1ms).count;
    received += b->receive(out, 0ns).count;
  }
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(received, 2000u);
}

}  // namespace
}  // namespace faultline

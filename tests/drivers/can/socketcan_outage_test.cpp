// What a SocketCanBus survives: its interface down or gone, its queue full, a flood. Needs vcan0 up
// and the right to make interfaces: run inside tools/with-vcan -M sch_tbf.
#include <array>
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

#include <pthread.h>
#include <sched.h>

#include <gtest/gtest.h>

#include "drivers/can/bus_group.h"
#include "drivers/can/socketcan_bus.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/bus_traffic.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;

std::array<CanFrame, SocketCanBus::kBatch> out;

TEST(SocketCanOutage, IsReportedOnceAndEndsWhenTheInterfaceIsUpAgain) {
  const TemporaryInterface interface;
  interface.set("mtu 72 up");
  const auto a = open_socketcan(interface.name);
  const auto b = open_socketcan(interface.name);
  EXPECT_TRUE(b->is_up());
  interface.set("down");
  EXPECT_EQ(b->receive(out, kPatience).status, ReceiveStatus::kDown);
  EXPECT_FALSE(b->is_up());
  EXPECT_EQ(b->receive(out, 30ms).status, ReceiveStatus::kTimeout);
  EXPECT_EQ(b->receive(out, 0ns).status, ReceiveStatus::kTimeout);
  EXPECT_FALSE(a->send(frame_with(1)));
  EXPECT_NE(a->last_error(), 0);
  EXPECT_EQ(a->counters().send_errors, 1u);
  interface.set("up");
  EXPECT_TRUE(a->send(frame_with(2)));
  EXPECT_TRUE(a->is_up());
  // Whether b heard that frame depends on nothing: the socket never left the interface.
  EXPECT_EQ(receive_frames(*b, 1).size(), 1u);
  EXPECT_TRUE(b->is_up());
  EXPECT_EQ(b->counters().outages, 1u);
  EXPECT_EQ(a->counters().outages, 1u);
}

TEST(SocketCanOutage, KeepsWhatWasQueuedBefore) {
  const TemporaryInterface interface;
  interface.set("up");
  const auto a = open_socketcan(interface.name);
  const auto b = open_socketcan(interface.name);
  ASSERT_TRUE(a->send(frame_with(1)));
  ASSERT_TRUE(a->send(frame_with(2)));
  interface.set("down");
  std::vector<CanFrame> received;
  int downs = 0;
  while (received.size() < 2 || downs == 0) {
    const ReceiveResult result = b->receive(out, kPatience);
    ASSERT_NE(result.status, ReceiveStatus::kTimeout);
    if (result.status == ReceiveStatus::kDown) ++downs;
    received.insert(received.end(), out.begin(),
                    out.begin() + static_cast<std::ptrdiff_t>(result.count));
  }
  EXPECT_EQ(downs, 1);
  EXPECT_EQ(received.size(), 2u);
}

TEST(SocketCanOutage, OfARemovedInterfaceEndsWhenOneOfThatNameIsThereWithFiltersAndErrorMask) {
  TemporaryInterface interface;
  interface.set("mtu 72 up");
  const auto a = open_socketcan(interface.name);
  const auto b = open_socketcan(interface.name);
  const std::array<IdFilter, 1> filters{{{0x10, false}}};
  b->set_filters(filters);
  for (int round = 1; round <= 3; ++round) {
    interface.remove();
    EXPECT_EQ(b->receive(out, kPatience).status, ReceiveStatus::kDown);
    EXPECT_EQ(b->receive(out, 20ms).status, ReceiveStatus::kTimeout);
    const std::array<CanFrame, 3> lost{frame_with(0x10), frame_with(0x10), frame_with(0x10)};
    EXPECT_EQ(a->send_batch(lost), 0u);
    interface.add();
    EXPECT_EQ(b->receive(out, 20ms).status, ReceiveStatus::kTimeout);  // it is not up yet
    EXPECT_FALSE(b->is_up());
    interface.set("mtu 72 up");
    EXPECT_EQ(b->receive(out, 20ms).status, ReceiveStatus::kTimeout);
    EXPECT_TRUE(b->is_up());
    CanFrame error = frame_with(0x40);
    error.is_error = true;
    const std::array<CanFrame, 4> frames{frame_with(0x11), frame_with(0x10, 7),
                                         fd_frame_with(0x10, 64), error};
    EXPECT_EQ(a->send_batch(frames), 4u);
    const auto received = receive_frames(*b, 3);
    ASSERT_EQ(received.size(), 3u) << round;
    EXPECT_TRUE(same_on_wire(received[0], frames[1]));
    EXPECT_TRUE(same_on_wire(received[1], frames[2]));
    EXPECT_TRUE(same_on_wire(received[2], error));
    EXPECT_EQ(b->counters().outages, static_cast<std::uint64_t>(round));
    EXPECT_EQ(a->counters().send_errors, static_cast<std::uint64_t>(3 * round));
  }
  EXPECT_EQ(b->counters().bus_offs, 3u);
}

TEST(SocketCanOutage, IsReportedOnceAlsoIfItWasOverBeforeAnybodyLooked) {
  TemporaryInterface interface;
  interface.set("up");
  const auto a = open_socketcan(interface.name);
  const auto b = open_socketcan(interface.name);
  interface.remove();
  interface.add();
  interface.set("up");
  EXPECT_EQ(b->receive(out, kPatience).status, ReceiveStatus::kDown);
  EXPECT_EQ(b->receive(out, 20ms).status, ReceiveStatus::kTimeout);
  a->send(frame_with(1));  // a notices with its first send, and may lose it
  EXPECT_TRUE(a->send(frame_with(2)));
  EXPECT_GE(drain(*b).size(), 1u);
  EXPECT_EQ(b->counters().outages, 1u);
}

TEST(SocketCanOutage, ThatTheSenderNoticedIsReportedToTheReceiverOnce) {
  const TemporaryInterface interface;
  interface.set("up");
  const auto bus = open_socketcan(interface.name);
  interface.set("down");
  EXPECT_FALSE(bus->send(frame_with(1)));
  EXPECT_FALSE(bus->is_up());
  EXPECT_FALSE(bus->send(frame_with(1)));
  interface.set("up");
  EXPECT_TRUE(bus->send(frame_with(1)));
  EXPECT_EQ(bus->receive(out, kPatience).status, ReceiveStatus::kDown);
  EXPECT_EQ(bus->receive(out, 20ms).status, ReceiveStatus::kTimeout);
  EXPECT_EQ(bus->counters().outages, 1u);
  EXPECT_EQ(bus->counters().send_errors, 2u);
}

TEST(SocketCanOutage, DoesNotKeepAWaitingReceiverFromWhatComesAfterIt) {
  TemporaryInterface interface;
  interface.set("up");
  const auto bus = open_socketcan(interface.name);
  std::atomic<bool> has_frame{false};
  std::atomic<int> downs{0};
  std::thread receiver([&] {
    std::array<CanFrame, 4> batch;
    for (int calls = 0; calls < 3 && !has_frame; ++calls) {
      const ReceiveResult result = bus->receive(batch, std::chrono::nanoseconds::max());
      if (result.status == ReceiveStatus::kDown) ++downs;
      if (result.status == ReceiveStatus::kOk) has_frame = batch[0].id == 5;
    }
  });
  std::this_thread::sleep_for(20ms);
  interface.remove();
  std::this_thread::sleep_for(20ms);
  interface.add();
  interface.set("up");
  const auto sender = open_socketcan(interface.name);
  for (int tries = 0; tries < 500 && !has_frame; ++tries) {  // until the receiver has bound again
    sender->send(frame_with(5));
    std::this_thread::sleep_for(10ms);
  }
  receiver.join();
  EXPECT_TRUE(has_frame);
  EXPECT_EQ(downs, 1);
}

TEST(SocketCanOutage, LeavesTheDropCountExact) {
  TemporaryInterface interface;
  interface.set("up");
  SocketCanOptions small;
  small.receive_buffer_bytes = 1;  // the kernel gives its least
  const auto sender = open_socketcan(interface.name);
  const auto slow = open_socketcan(interface.name, small);
  const InputBacklogWatch backlog;
  std::uint64_t received = 0;
  for (int round = 0; round < 3; ++round) {
    for (int n = 0; n < 500; ++n) ASSERT_TRUE(sender->send(frame_with(1)));
    received += drain(*slow).size();
    ASSERT_TRUE(sender->send(frame_with(2)));
    received += receive_frames(*slow, 1).size();
    interface.remove();
    interface.add();
    interface.set("up");
    EXPECT_EQ(slow->receive(out, kPatience).status, ReceiveStatus::kDown);
    EXPECT_EQ(slow->receive(out, 20ms).status, ReceiveStatus::kTimeout);
    sender->send(frame_with(3));  // fails or not: it is counted
    received += drain(*slow).size();
  }
  EXPECT_EQ(slow->counters().received, received);
  EXPECT_GT(slow->counters().dropped, 500u);
  expect_all_accounted(sender->counters().sent, received, slow->counters().dropped, backlog);
}

TEST(SocketCanOutage, OfOneBusOfAGroupLeavesTheOthersAtWork) {
  TemporaryInterface interface;
  interface.set("up");
  std::vector<std::unique_ptr<CanBus>> members;
  members.push_back(open_socketcan("vcan0"));
  members.push_back(open_socketcan(interface.name));
  BusGroup group(std::move(members));
  const auto on_vcan0 = open_socketcan("vcan0");
  interface.remove();
  EXPECT_EQ(group.receive(out, 20ms).status, ReceiveStatus::kTimeout);
  EXPECT_EQ(group.counters().outages, 1u);
  EXPECT_TRUE(group.is_up());
  ASSERT_TRUE(on_vcan0->send(frame_with(1)));
  ASSERT_EQ(group.receive(out, kPatience).status, ReceiveStatus::kOk);
  EXPECT_EQ(out[0].bus, 0);
  interface.add();
  interface.set("up");
  EXPECT_EQ(group.receive(out, 30ms).status, ReceiveStatus::kTimeout);
  EXPECT_TRUE(group.member(1).is_up());
  const auto on_other = open_socketcan(interface.name);
  ASSERT_TRUE(on_other->send(frame_with(2)));
  ASSERT_EQ(group.receive(out, kPatience).status, ReceiveStatus::kOk);
  EXPECT_EQ(out[0].bus, 1);
  CanFrame tagged = frame_with(3);
  tagged.bus = 1;
  EXPECT_TRUE(group.send(tagged));
  EXPECT_EQ(receive_frames(*on_other, 1).size(), 1u);
  EXPECT_EQ(group.name(), "can:vcan0,can:vcantmp");
}

TEST(SocketCanOutage, DoesNotAllocate) {
  const TemporaryInterface interface;
  interface.set("up");
  const auto bus = open_socketcan(interface.name);
  interface.set("down");
  const AllocationGuard guard;
  for (int step = 0; step < 20; ++step) {
    static_cast<void>(bus->receive(out, 1ms));
    static_cast<void>(bus->send(out[0]));
  }
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(bus->counters().send_errors, 20u);
}

TEST(SocketCanFullQueue, LosesDoublesAndReordersNothing) {
  const TemporaryInterface interface("vcanslow");
  interface.set("up");
  // 16 bytes a frame: 4000 frames a second, and room for twenty.
  run_command("tc qdisc add dev vcanslow root tbf rate 512kbit burst 320 limit 320");
  const auto sender = open_socketcan(interface.name);
  const auto receiver = open_socketcan(interface.name);
  constexpr std::uint32_t kFrames = 2000;
  std::vector<CanFrame> frames;
  for (std::uint32_t n = 0; n < kFrames; ++n) frames.push_back(numbered_frame(n));
  EXPECT_EQ(sender->send_batch(frames), kFrames);
  EXPECT_EQ(sender->counters().sent, kFrames);
  EXPECT_EQ(sender->counters().send_errors, 0u);
  const auto received = receive_frames(*receiver, kFrames);
  ASSERT_EQ(received.size(), kFrames);
  for (std::uint32_t n = 0; n < kFrames; ++n) ASSERT_EQ(number_of(received[n]), n);
  EXPECT_TRUE(drain(*receiver).empty());
}

TEST(SocketCanFullQueue, ThatStaysFullFailsAndWorksAgainWhenItMoves) {
  const TemporaryInterface interface("vcanstuck");
  interface.set("up");
  // Half a frame a second.
  run_command("tc qdisc add dev vcanstuck root tbf rate 64bit burst 32 limit 320");
  const auto sender = open_socketcan(interface.name);
  const auto receiver = open_socketcan(interface.name);
  std::vector<CanFrame> frames;
  for (std::uint32_t n = 0; n < 100; ++n) frames.push_back(numbered_frame(n));
  const std::size_t taken = sender->send_batch(frames);
  EXPECT_GE(taken, 1u);
  EXPECT_LT(taken, frames.size());
  EXPECT_EQ(sender->counters().sent, taken);
  EXPECT_EQ(sender->counters().send_errors, frames.size() - taken);
  EXPECT_EQ(sender->last_error(), ENOBUFS);
  run_command("tc qdisc del dev vcanstuck root");
  EXPECT_TRUE(sender->send(numbered_frame(1000)));
  const auto received = drain(*receiver);
  ASSERT_GE(received.size(), 1u);
  EXPECT_EQ(number_of(received.back()), 1000u);
  for (std::size_t n = 0; n + 1 < received.size(); ++n) EXPECT_EQ(number_of(received[n]), n);
}

TEST(SocketCanFlood, AtTwentyThousandFramesASecondLosesNothingUncounted) {
  SocketCanOptions small;
  small.receive_buffer_bytes = 1;
  const auto sender = open_socketcan("vcan0");
  const auto reader = open_socketcan("vcan0", small);
  flood(*sender, *reader, 40'000, 20e3);
}

TEST(SocketCanFlood, UnpacedLosesNothingUncounted) {
  SocketCanOptions small;
  small.receive_buffer_bytes = 20'000;
  const auto sender = open_socketcan("vcan0");
  const auto reader = open_socketcan("vcan0", small);
  flood(*sender, *reader, 100'000, 0.0);
}

TEST(SocketCanFlood, OfARealTimeThreadThatLetsNobodyReadLosesNothingUncounted) {
  SocketCanOptions small;
  small.receive_buffer_bytes = 20'000;
  const auto sender = open_socketcan("vcan0");
  const auto reader = open_socketcan("vcan0", small);
  std::thread real_time([&] {
    // Before it, the kernel's own thread that empties the input backlog does not get to run. Where
    // the right is missing it is a flood like the others.
    const sched_param priority{.sched_priority = 50};
    static_cast<void>(::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &priority));
    flood(*sender, *reader, 100'000, 0.0);
  });
  real_time.join();
}

}  // namespace
}  // namespace faultline

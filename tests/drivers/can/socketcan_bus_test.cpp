#include "drivers/can/socketcan_bus.h"

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include <poll.h>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"
#include "tests/support/bus_traffic.h"

// Needs vcan0 and vcan1 up: run inside tools/with-vcan -i vcan0 -i vcan1.

namespace faultline {
namespace {

using namespace std::chrono_literals;

std::string error_of_opening(const std::string& interface_name) {
  try {
    static_cast<void>(open_socketcan(interface_name));
  } catch (const BusError& error) {
    return error.what();
  }
  return "no error";
}

/// What `command` prints.
std::string output_of(const std::string& command) {
  std::string output;
  std::FILE* const pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) return output;
  std::array<char, 256> part;
  while (std::fgets(part.data(), part.size(), pipe) != nullptr) output += part.data();
  ::pclose(pipe);
  return output;
}

TEST(SocketCanBus, CarriesAClassicFrame) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  ASSERT_TRUE(a->send(frame_with(0x123, 10)));
  const auto received = receive_frames(*b, 1);
  ASSERT_EQ(received.size(), 1u);
  EXPECT_TRUE(same_on_wire(received[0], frame_with(0x123, 10)));
  EXPECT_EQ(a->counters().sent, 1u);
  EXPECT_EQ(b->counters().received, 1u);
}

TEST(SocketCanBus, CarriesEveryKindOfFrame) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  std::vector<CanFrame> frames{frame_with(0), frame_with(kMaxStandardId)};
  frames.push_back(frame_with(0x12));
  frames.back().is_extended = true;
  frames.push_back(frame_with(kMaxExtendedId));
  frames.back().is_extended = true;
  CanFrame remote;
  remote.id = 0x33;
  remote.is_remote = true;
  remote.length = 4;
  frames.push_back(remote);
  frames.push_back(fd_frame_with(0x44, 64));
  frames.push_back(fd_frame_with(0x45, 0));
  frames.push_back(fd_frame_with(0x46, 12));
  frames.back().is_bit_rate_switched = true;
  frames.push_back(fd_frame_with(0x1234567, 48));
  frames.back().is_extended = true;
  frames.back().is_error_state = true;
  for (const CanFrame& frame : frames) ASSERT_TRUE(a->send(frame));
  const auto received = receive_frames(*b, frames.size());
  ASSERT_EQ(received.size(), frames.size());
  for (std::size_t n = 0; n < frames.size(); ++n) {
    EXPECT_TRUE(same_on_wire(received[n], frames[n])) << "frame " << n;
  }
}

TEST(SocketCanBus, DeliversZeroBeyondThePayload) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  CanFrame frame = frame_with(1);
  frame.data.fill(0xAA);
  frame.length = 3;
  ASSERT_TRUE(a->send(frame));
  const auto received = receive_frames(*b, 1);
  ASSERT_EQ(received.size(), 1u);
  for (std::size_t n = 0; n < kMaxPayload; ++n) {
    EXPECT_EQ(received[0].data[n], n < 3 ? 0xAA : 0x00) << "byte " << n;
  }
}

TEST(SocketCanBus, RefusesMalformedFramesAndCountsThem) {
  const auto a = open_socketcan("vcan0");
  CanFrame too_long = frame_with(1);
  too_long.length = 9;
  EXPECT_FALSE(a->send(too_long));
  const std::array<CanFrame, 3> batch{frame_with(1), frame_with(0x800), frame_with(2)};
  EXPECT_EQ(a->send_batch(batch), 2u);
  EXPECT_EQ(a->counters().sent, 2u);
  EXPECT_EQ(a->counters().send_errors, 2u);
}

TEST(SocketCanBus, StampsWithTheKernelsReceiveTime) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  const Timestamp before = std::chrono::system_clock::now();
  a->send(frame_with(1));
  const Timestamp after = std::chrono::system_clock::now();
  std::this_thread::sleep_for(20ms);  // the stamp is of the arrival, not of the reading
  const auto received = receive_frames(*b, 1);
  ASSERT_EQ(received.size(), 1u);
  // A clock tick of the kernel's coarsest clock source either way.
  EXPECT_GE(received[0].stamp, before - 10ms);
  EXPECT_LE(received[0].stamp, after + 10ms);
}

TEST(SocketCanBus, ReadsManyFramesInOneBatch) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  std::vector<CanFrame> frames;
  for (std::uint8_t n = 0; n < 150; ++n) frames.push_back(frame_with(n, n));
  EXPECT_EQ(a->send_batch(frames), 150u);
  std::array<CanFrame, 200> out;
  std::vector<CanFrame> received;
  for (const std::size_t expected : {std::size_t{64}, std::size_t{64}, std::size_t{22}}) {
    const ReceiveResult result = b->receive(out, kPatience);
    ASSERT_EQ(result.status, ReceiveStatus::kOk);
    ASSERT_EQ(result.count, expected);
    received.insert(received.end(), out.begin(),
                    out.begin() + static_cast<std::ptrdiff_t>(expected));
  }
  for (std::size_t n = 0; n < frames.size(); ++n) {
    EXPECT_TRUE(same_on_wire(received[n], frames[n])) << "frame " << n;
  }
}

TEST(SocketCanBus, ReadsAtMostWhatTheSpanHolds) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  for (std::uint8_t n = 0; n < 5; ++n) a->send(frame_with(n));
  std::array<CanFrame, 3> out;
  EXPECT_EQ(b->receive(out, kPatience).count, 3u);
  EXPECT_EQ(b->receive(out, kPatience).count, 2u);
  EXPECT_EQ(b->receive({}, kPatience).status, ReceiveStatus::kTimeout);
}

TEST(SocketCanBus, DoesNotReceiveItsOwnFramesUnlessAsked) {
  const auto a = open_socketcan("vcan0");
  SocketCanOptions with_own;
  with_own.receive_own = true;
  const auto b = open_socketcan("vcan0", with_own);
  a->send(frame_with(1));
  b->send(frame_with(2));
  EXPECT_EQ(receive_frames(*b, 2).size(), 2u);
  const auto at_a = drain(*a);
  ASSERT_EQ(at_a.size(), 1u);
  EXPECT_EQ(at_a[0].id, 2u);
}

TEST(SocketCanBus, KeepsInterfacesApart) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan1");
  a->send(frame_with(1));
  EXPECT_TRUE(drain(*b).empty());
}

TEST(SocketCanBus, HonoursTheTimeout) {
  const auto a = open_socketcan("vcan0");
  std::array<CanFrame, 1> out;
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(a->receive(out, 30ms).status, ReceiveStatus::kTimeout);
  const auto waited = std::chrono::steady_clock::now() - begin;
  EXPECT_GE(waited, 30ms);
  EXPECT_LT(waited, kPatience);
  EXPECT_EQ(a->receive(out, 0ns).status, ReceiveStatus::kTimeout);
  EXPECT_EQ(a->receive(out, -1s).status, ReceiveStatus::kTimeout);
}

TEST(SocketCanBus, WakesAWaitingReceiver) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  std::thread sender([&] {
    std::this_thread::sleep_for(20ms);
    a->send(frame_with(5));
  });
  std::array<CanFrame, 1> out;
  EXPECT_EQ(b->receive(out, std::chrono::nanoseconds::max()).status, ReceiveStatus::kOk);
  sender.join();
  EXPECT_EQ(out[0].id, 5u);
}

TEST(SocketCanBus, HasADescriptorThatSaysWhenAFrameIsThere) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  pollfd readiness{b->readiness_fd(), POLLIN, 0};
  EXPECT_EQ(::poll(&readiness, 1, 0), 0);
  a->send(frame_with(1));
  EXPECT_EQ(::poll(&readiness, 1, 5000), 1);
  EXPECT_EQ(b->name(), "can:vcan0");
}

TEST(SocketCanBus, CountsDroppedFramesExactly) {
  const auto a = open_socketcan("vcan0");
  SocketCanOptions small;
  small.receive_buffer_bytes = 1;  // the kernel gives its least
  const auto slow = open_socketcan("vcan0", small);
  const InputBacklogWatch backlog;
  constexpr std::size_t kFlood = 3000;
  std::size_t received = 0;
  for (int round = 0; round < 3; ++round) {
    for (std::size_t n = 0; n < kFlood; ++n) ASSERT_TRUE(a->send(frame_with(1)));
    received += drain(*slow).size();
  }
  // The kernel tells of drops with the next frame.
  ASSERT_TRUE(a->send(frame_with(2)));
  received += receive_frames(*slow, 1).size();
  EXPECT_EQ(a->counters().sent, 3 * kFlood + 1);
  EXPECT_EQ(slow->counters().received, received);
  expect_all_accounted(a->counters().sent, received, slow->counters().dropped, backlog);
  EXPECT_GT(slow->counters().dropped, kFlood);
}

TEST(SocketCanBus, GetsAReceiveBufferThatHoldsMoreThanTheKernelsDefault) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  EXPECT_GE(b->granted_receive_buffer(), SocketCanOptions().receive_buffer_bytes);
  const InputBacklogWatch backlog;
  const std::vector<CanFrame> flood(3000, frame_with(1));
  EXPECT_EQ(a->send_batch(flood), flood.size());
  expect_all_accounted(flood.size(), drain(*b).size(), 0, backlog);
  a->send(frame_with(2));  // the kernel tells of drops with the next frame
  EXPECT_EQ(receive_frames(*b, 1).size(), 1u);
  EXPECT_EQ(b->counters().dropped, 0u);
}

TEST(SocketCanBus, FiltersByIdentifierAndFormat) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  const std::array<IdFilter, 2> filters{{{0x10, false}, {0x12345, true}}};
  b->set_filters(filters);
  CanFrame extended = frame_with(0x12345);
  extended.is_extended = true;
  CanFrame short_id_extended = frame_with(0x10);
  short_id_extended.is_extended = true;
  for (const CanFrame& frame :
       {frame_with(0x10), frame_with(0x11), short_id_extended, frame_with(0x345), extended}) {
    a->send(frame);
  }
  const auto received = drain(*b);
  ASSERT_EQ(received.size(), 2u);
  EXPECT_TRUE(same_on_wire(received[0], frame_with(0x10)));
  EXPECT_TRUE(same_on_wire(received[1], extended));
  b->set_filters({});
  a->send(frame_with(0x11));
  EXPECT_EQ(drain(*b).size(), 1u);
}

TEST(SocketCanBus, SaysHowManyFiltersItCouldNotSet) {
  const auto a = open_socketcan("vcan0");
  const std::vector<IdFilter> filters(1000);
  EXPECT_THROW(a->set_filters(filters), BusError);
}

TEST(SocketCanBus, LetsErrorFramesPassOnlyWhenAskedTo) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  const std::array<IdFilter, 1> filters{{{0x10, false}}};
  b->set_filters(filters);
  SocketCanOptions quiet;
  quiet.receive_error_frames = false;
  const auto c = open_socketcan("vcan0", quiet);
  CanFrame error = frame_with(0x4);
  error.is_error = true;
  ASSERT_TRUE(a->send(error));
  const auto received = receive_frames(*b, 1);
  ASSERT_EQ(received.size(), 1u);
  EXPECT_TRUE(same_on_wire(received[0], error));
  EXPECT_TRUE(drain(*c).empty());
}

TEST(SocketCanBus, NamesTheInterfacesThereAreWhenOneIsMissing) {
  const std::string error = error_of_opening("nosuch0");
  EXPECT_EQ(error.find("can:nosuch0: no such interface; CAN interfaces here: "), 0u) << error;
  EXPECT_NE(error.find("vcan0"), std::string::npos) << error;
  EXPECT_NE(error.find("vcan1"), std::string::npos) << error;
}

TEST(SocketCanBus, RefusesAnInterfaceThatIsNoCan) {
  const std::string error = error_of_opening("lo");
  EXPECT_EQ(error.find("can:lo: not a CAN interface; CAN interfaces here: "), 0u) << error;
}

TEST(SocketCanBus, RefusesNamesThatNoInterfaceCanHave) {
  EXPECT_EQ(error_of_opening(""), "can:: interface name of 0 characters, expected 1 to 15");
  EXPECT_EQ(error_of_opening("sixteen_letters_"),
            "can:sixteen_letters_: interface name of 16 characters, expected 1 to 15");
}

TEST(SocketCanBus, TellsHowToBringAnInterfaceUp) {
  const TemporaryInterface interface;
  EXPECT_EQ(error_of_opening(interface.name),
            "can:vcantmp: the interface is down: ip link set vcantmp up");
}

TEST(SocketCanBus, ReceivesWhatCansendSends) {
  const auto bus = open_socketcan("vcan0");
  run_command("cansend vcan0 123#DEADBEEF");
  run_command("cansend vcan0 01234567##1.00112233445566778899AABB");
  const auto received = receive_frames(*bus, 2);
  ASSERT_EQ(received.size(), 2u);
  EXPECT_EQ(received[0].id, 0x123u);
  EXPECT_EQ(received[0].length, 4);
  EXPECT_EQ(received[0].data[0], 0xDE);
  EXPECT_EQ(received[1].id, 0x01234567u);
  EXPECT_TRUE(received[1].is_extended);
  EXPECT_TRUE(received[1].is_fd);
  EXPECT_TRUE(received[1].is_bit_rate_switched);
  EXPECT_EQ(received[1].length, 12);
  EXPECT_EQ(received[1].data[11], 0xBB);
}

TEST(SocketCanBus, SendsWhatCandumpUnderstands) {
  const auto bus = open_socketcan("vcan1");
  std::string printed;
  std::atomic<bool> is_over{false};
  std::thread reader([&] {
    printed = output_of("candump -L -n 2 -T 4000 vcan1");
    is_over = true;
  });
  CanFrame fd = fd_frame_with(0x456, 3);
  fd.is_bit_rate_switched = true;
  const std::array<CanFrame, 2> frames{frame_with(0x123, 1), fd};
  while (!is_over) {  // candump needs its time to start
    bus->send_batch(frames);
    std::this_thread::sleep_for(50ms);
  }
  reader.join();
  EXPECT_NE(printed.find("vcan1 123#0102030405060708"), std::string::npos) << printed;
  // The digit before the data is the flags: BRS is 1; newer kernels add 4 for "FD" themselves.
  const bool has_fd = printed.find("vcan1 456##1FFFEFD") != std::string::npos ||
                      printed.find("vcan1 456##5FFFEFD") != std::string::npos;
  EXPECT_TRUE(has_fd) << printed;
}

TEST(SocketCanBus, DoesNotAllocateAfterOpening) {
  const auto a = open_socketcan("vcan0");
  const auto b = open_socketcan("vcan0");
  const std::array<CanFrame, 3> frames{frame_with(1), fd_frame_with(2, 64), frame_with(3)};
  std::array<CanFrame, 8> out;
  std::size_t received = 0;
  const AllocationGuard guard;
  for (int step = 0; step < 1000; ++step) {
    a->send_batch(frames);
    a->send(frames[0]);
    received += b->receive(out, 1ms).count;
    received += b->receive(out, 0ns).count;
  }
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(received + drain(*b).size(), 4000u);
}

}  // namespace
}  // namespace faultline

#include "drivers/can/udp_bus.h"

#include <array>
#include <chrono>
#include <cstring>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <poll.h>
#include <sched.h>
#include <unistd.h>

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "drivers/can/bus_group.h"
#include "drivers/can/open_bus.h"
#include "drivers/can/udp_frame.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/bus_traffic.h"
#include "tests/support/random_can_frame.h"

// Needs a network namespace of its own with multicast on lo: see tests/drivers/CMakeLists.txt.

namespace faultline {
namespace {

using namespace std::chrono_literals;

constexpr const char* kGroup = "239.74.163.2";
constexpr const char* kGroupV6 = "ff15:7079:7468:6f6e:6465:6d6f:6d63:6173";
constexpr std::uint16_t kPort = 43113;

std::array<CanFrame, 100> out;

std::unique_ptr<UdpBus> open_udp(int receive_buffer_bytes = UdpBusOptions().receive_buffer_bytes) {
  return std::make_unique<UdpBus>(kGroup, kPort, UdpBusOptions{receive_buffer_bytes});
}

/// A socket that sends what is no frame, too.
class Intruder {
 public:
  Intruder() : fd_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    address_.sin_family = AF_INET;
    address_.sin_port = htons(kPort);
    ::inet_pton(AF_INET, kGroup, &address_.sin_addr);
  }
  ~Intruder() { ::close(fd_); }
  Intruder(const Intruder&) = delete;
  Intruder& operator=(const Intruder&) = delete;
  void send(const std::vector<std::uint8_t>& datagram) const {
    ASSERT_EQ(::sendto(fd_, datagram.data(), datagram.size(), 0,
                       reinterpret_cast<const sockaddr*>(&address_), sizeof address_),
              static_cast<ssize_t>(datagram.size()));
  }

 private:
  int fd_;
  sockaddr_in address_{};
};

TEST(UdpBus, CarriesEveryKindOfFrameOverBothVersionsOfIp) {
  for (const char* group : {kGroup, kGroupV6}) {
    UdpBus a(group, kPort);
    UdpBus b(group, kPort);
    std::mt19937_64 generator(1);
    std::vector<CanFrame> frames;
    for (int n = 0; n < 300; ++n) frames.push_back(random_can_frame(generator));
    EXPECT_EQ(a.send_batch(frames), frames.size());
    const auto received = receive_frames(b, frames.size());
    ASSERT_EQ(received.size(), frames.size()) << group;
    for (std::size_t n = 0; n < frames.size(); ++n) {
      EXPECT_TRUE(same_on_wire(received[n], frames[n])) << n;
    }
    EXPECT_EQ(a.counters().sent, 300u);
    EXPECT_EQ(b.counters().received, 300u);
    EXPECT_GT(b.counters().error_frames, 0u);
  }
}

TEST(UdpBus, NeverReceivesItsOwnFramesWhoeverElseDoes) {
  const auto a = open_udp();
  const auto b = open_udp();
  const auto c = open_udp();
  ASSERT_TRUE(a->send(frame_with(1)));
  ASSERT_TRUE(b->send(frame_with(2)));
  const auto at_a = drain(*a), at_b = drain(*b), at_c = drain(*c);
  ASSERT_EQ(at_a.size(), 1u);
  EXPECT_EQ(at_a[0].id, 2u);
  ASSERT_EQ(at_b.size(), 1u);
  EXPECT_EQ(at_b[0].id, 1u);
  EXPECT_EQ(at_c.size(), 2u);
  for (const auto* bus : {a.get(), b.get(), c.get()}) EXPECT_EQ(bus->counters().dropped, 0u);
}

TEST(UdpBus, IsNotWokenByItsOwnFrames) {
  const auto a = open_udp();
  const auto b = open_udp();
  pollfd readiness{a->readiness_fd(), POLLIN, 0};
  ASSERT_TRUE(a->send(frame_with(1)));
  EXPECT_EQ(receive_frames(*b, 1).size(), 1u);
  EXPECT_EQ(::poll(&readiness, 1, 50), 0);
  ASSERT_TRUE(b->send(frame_with(1)));
  EXPECT_EQ(::poll(&readiness, 1, 5000), 1);
}

TEST(UdpBus, KeepsGroupsAndPortsApart) {
  const auto a = open_udp();
  UdpBus other_group("239.74.163.3", kPort);
  UdpBus other_port(kGroup, kPort + 1);
  ASSERT_TRUE(a->send(frame_with(1)));
  EXPECT_TRUE(drain(other_group).empty());
  EXPECT_TRUE(drain(other_port).empty());
}

TEST(UdpBus, StampsWithTheKernelsReceiveTimeNotTheSenders) {
  const auto a = open_udp();
  const auto b = open_udp();
  const Timestamp before = std::chrono::system_clock::now();
  CanFrame frame = frame_with(1);
  frame.stamp = Timestamp(1s);
  ASSERT_TRUE(a->send(frame));
  const Timestamp after = std::chrono::system_clock::now();
  std::this_thread::sleep_for(20ms);
  const auto received = receive_frames(*b, 1);
  ASSERT_EQ(received.size(), 1u);
  EXPECT_GE(received[0].stamp, before - 10ms);
  EXPECT_LE(received[0].stamp, after + 10ms);
}

TEST(UdpBus, CountsDatagramsThatAreNoFrame) {
  const auto bus = open_udp();
  const Intruder intruder;
  intruder.send({});
  intruder.send({0xC1});
  intruder.send(std::vector<std::uint8_t>(UdpBus::kLongestDatagram + 1, 0x00));
  intruder.send(std::vector<std::uint8_t>(5000, 0x80));
  std::vector<std::uint8_t> datagram(kLongestUdpFrame);
  datagram.resize(encode_udp_frame(frame_with(7), datagram));
  intruder.send(datagram);
  datagram.push_back(0);
  intruder.send(datagram);
  const auto received = drain(*bus);
  ASSERT_EQ(received.size(), 1u);
  EXPECT_EQ(received[0].id, 7u);
  EXPECT_EQ(bus->counters().malformed, 5u);
  EXPECT_EQ(bus->counters().received, 1u);
}

TEST(UdpBus, RefusesMalformedFramesAndCountsThem) {
  const auto a = open_udp();
  const auto b = open_udp();
  const std::array<CanFrame, 3> batch{frame_with(1), frame_with(0x800), frame_with(2)};
  EXPECT_EQ(a->send_batch(batch), 2u);
  EXPECT_EQ(a->counters().send_errors, 1u);
  EXPECT_EQ(drain(*b).size(), 2u);
}

TEST(UdpBus, FiltersByIdentifierAndFormatButNotErrorFrames) {
  const auto a = open_udp();
  const auto b = open_udp();
  const std::array<IdFilter, 2> filters{{{0x10, false}, {0x12345, true}}};
  b->set_filters(filters);
  CanFrame extended = frame_with(0x12345);
  extended.is_extended = true;
  CanFrame short_id_extended = frame_with(0x10);
  short_id_extended.is_extended = true;
  CanFrame error = frame_with(0x40);
  error.is_error = true;
  for (const CanFrame& frame :
       {frame_with(0x10), frame_with(0x11), short_id_extended, extended, error}) {
    ASSERT_TRUE(a->send(frame));
  }
  const auto received = drain(*b);
  ASSERT_EQ(received.size(), 3u);
  EXPECT_TRUE(same_on_wire(received[1], extended));
  EXPECT_TRUE(same_on_wire(received[2], error));
  EXPECT_EQ(b->counters().received, 3u);
  for (int n = 0; n < 500; ++n) ASSERT_TRUE(a->send(frame_with(0x11)));
  EXPECT_EQ(b->receive(out, 50ms).status, ReceiveStatus::kTimeout);
  EXPECT_EQ(b->receive(out, 0ns).status, ReceiveStatus::kTimeout);
  b->set_filters({});
  ASSERT_TRUE(a->send(frame_with(0x11)));
  EXPECT_EQ(drain(*b).size(), 1u);
}

TEST(UdpBus, HonoursTheTimeoutAndTheSpan) {
  const auto a = open_udp();
  const auto b = open_udp();
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(a->receive(out, 30ms).status, ReceiveStatus::kTimeout);
  EXPECT_GE(std::chrono::steady_clock::now() - begin, 30ms);
  EXPECT_EQ(a->receive(out, 0ns).status, ReceiveStatus::kTimeout);
  EXPECT_EQ(a->receive(out, -1s).status, ReceiveStatus::kTimeout);
  for (std::uint8_t n = 0; n < 5; ++n) ASSERT_TRUE(b->send(frame_with(n)));
  EXPECT_EQ(a->receive(std::span(out).first(3), std::chrono::nanoseconds::max()).count, 3u);
  EXPECT_EQ(a->receive(std::span(out).first(3), 0ns).count, 2u);
  EXPECT_EQ(a->receive({}, 0ns).status, ReceiveStatus::kTimeout);
}

TEST(UdpBus, SendsOneHopFar) {
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  ASSERT_EQ(::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on), 0);
  ASSERT_EQ(::setsockopt(fd, IPPROTO_IP, IP_RECVTTL, &on, sizeof on), 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(kPort);
  ASSERT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  const auto bus = open_udp();  // it joins the group for the host
  ASSERT_TRUE(bus->send(frame_with(1)));
  std::array<std::uint8_t, 512> datagram;
  alignas(cmsghdr) std::array<std::byte, 64> notes;
  iovec vector{datagram.data(), datagram.size()};
  msghdr message{};
  message.msg_iov = &vector;
  message.msg_iovlen = 1;
  message.msg_control = notes.data();
  message.msg_controllen = notes.size();
  ASSERT_GT(::recvmsg(fd, &message, 0), 0);
  const cmsghdr* note = CMSG_FIRSTHDR(&message);
  ASSERT_NE(note, nullptr);
  ASSERT_EQ(note->cmsg_type, IP_TTL);
  int hops = 0;
  std::memcpy(&hops, CMSG_DATA(note), sizeof hops);
  EXPECT_EQ(hops, 1);
  ::close(fd);
}

TEST(UdpBus, CountsDropsExactly) {
  const auto sender = open_udp();
  const auto reader = open_udp(1);  // the kernel gives its least
  flood(*sender, *reader, 40'000, 20e3);
}

TEST(UdpBus, CountsDropsExactlyUnpaced) {
  const auto sender = open_udp();
  const auto reader = open_udp(20'000);
  flood(*sender, *reader, 100'000, 0.0);
}

TEST(UdpBus, CountsDropsExactlyWhileItSendsItself) {
  const auto sender = open_udp();
  const auto reader = open_udp(1);
  const InputBacklogWatch backlog;
  std::uint64_t received = 0;
  for (std::uint32_t n = 0; n < 3000; ++n) {
    ASSERT_TRUE(sender->send(numbered_frame(n)));
    ASSERT_TRUE(reader->send(numbered_frame(n)));
    if (n % 100 == 0) {
      received += reader->receive(out, 0ns).count;
      ASSERT_LE(reader->counters().dropped + received, n + 1u);  // never too many
    }
  }
  received += drain(*reader).size();
  ASSERT_TRUE(sender->send(numbered_frame(0)));
  received += receive_frames(*reader, 1).size();
  EXPECT_GT(reader->counters().dropped, 0u);
  expect_all_accounted(sender->counters().sent, received, reader->counters().dropped, backlog);
  const std::uint64_t at_sender = drain(*sender).size();
  expect_all_accounted(reader->counters().sent, at_sender, sender->counters().dropped, backlog);
}

TEST(UdpBus, DoesNotAllocateAfterOpening) {
  const auto a = open_udp();
  const auto b = open_udp();
  const std::array<CanFrame, 3> frames{frame_with(1), fd_frame_with(2, 64), frame_with(3)};
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
  EXPECT_EQ(received, 4000u);
}

TEST(UdpBus, IsOpenedByItsName) {
  for (const char* name : {"udp:239.74.163.2:43113", "udp:[ff15::1]:43113"}) {
    const auto a = open_bus(name);
    const auto b = open_bus(name);
    EXPECT_EQ(a->name(), name);
    ASSERT_TRUE(a->send(frame_with(1)));
    EXPECT_EQ(receive_frames(*b, 1).size(), 1u);
  }
}

TEST(UdpBus, JoinsAGroupOfBuses) {
  const auto both = open_bus("udp:239.1.1.1:5000,udp:239.1.1.2:5000");
  const auto first = open_bus("udp:239.1.1.1:5000");
  const auto second = open_bus("udp:239.1.1.2:5000");
  ASSERT_TRUE(second->send(frame_with(2)));
  ASSERT_TRUE(first->send(frame_with(1)));
  const auto received = receive_frames(*both, 2);
  ASSERT_EQ(received.size(), 2u);
  EXPECT_EQ(received[0].bus, 1);
  EXPECT_EQ(received[1].bus, 0);
  CanFrame tagged = frame_with(3);
  tagged.bus = 1;
  EXPECT_TRUE(both->send(tagged));
  EXPECT_EQ(receive_frames(*second, 1).size(), 1u);
  EXPECT_TRUE(drain(*first).empty());
}

/// What `open` throws in a network namespace of its own after the commands of `set_up`, "" if it
/// does not.
std::string error_in_own_network(const std::string& set_up, const std::string& bus_name) {
  std::string error;
  std::thread apart([&] {
    ASSERT_EQ(::unshare(CLONE_NEWNET), 0);
    run_command(set_up);
    try {
      const auto a = open_bus(bus_name);
      const auto b = open_bus(bus_name);
      ASSERT_TRUE(a->send(frame_with(1)));
      EXPECT_EQ(receive_frames(*b, 1).size(), 1u);
    } catch (const BusError& failure) {
      error = failure.what();
    }
  });
  apart.join();
  return error;
}

TEST(UdpBus, TellsHowToMakeLoopbackCarryMulticast) {
  EXPECT_EQ(error_in_own_network("true", "udp:239.1.1.1:5000"),
            "udp:239.1.1.1:5000: no interface carries multicast to this group (Network is "
            "unreachable); within this host: ip link set lo up multicast on; ip route add "
            "224.0.0.0/4 dev lo");
  EXPECT_EQ(error_in_own_network("ip link set lo up", "udp:[ff15::1]:5000"),
            "udp:[ff15::1]:5000: no interface carries multicast to this group (Network is "
            "unreachable); within this host: ip link set lo up multicast on; ip -6 route add local "
            "ff00::/8 dev lo");
}

TEST(UdpBus, UsesLoopbackWhereOnlyThatCarriesMulticast) {
  EXPECT_EQ(error_in_own_network("ip link set lo up multicast on", "udp:239.1.1.1:5000"), "");
}

TEST(UdpBus, FollowsItsOwnAdvice) {
  EXPECT_EQ(error_in_own_network("ip link set lo up multicast on; ip route add 224.0.0.0/4 dev lo",
                                 "udp:239.1.1.1:5000"),
            "");
  EXPECT_EQ(
      error_in_own_network("ip link set lo up multicast on; ip -6 route add local ff00::/8 dev lo",
                           "udp:[ff15::1]:5000"),
      "");
}

TEST(UdpBus, GoesByTheInterfaceThatTheRouteNames) {
  EXPECT_EQ(error_in_own_network("ip link set lo up multicast on; ip link add veth0 type veth peer "
                                 "name veth1; ip link set veth0 up; ip link set veth1 up; ip addr "
                                 "add 10.1.1.1/24 dev veth0; ip route add default via 10.1.1.2",
                                 "udp:239.1.1.1:5000"),
            "");
}

TEST(UdpBus, RefusesWhatIsNoGroup) {
  EXPECT_THROW(UdpBus("127.0.0.1", 1), BusError);
  EXPECT_THROW(UdpBus("nonsense", 1), BusError);
  EXPECT_THROW(UdpBus(kGroup, 0), BusError);
}

}  // namespace
}  // namespace faultline

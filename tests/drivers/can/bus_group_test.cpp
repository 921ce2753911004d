#include "drivers/can/bus_group.h"

#include <array>
#include <stdexcept>
#include <vector>

#include <poll.h>
#include <unistd.h>

#include <gtest/gtest.h>
#include <sys/eventfd.h>

#include "drivers/can/loop_bus.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;

/// A bus whose other side is the test.
class ScriptedBus final : public CanBus {
 public:
  explicit ScriptedBus(std::string name) : name_(std::move(name)) {}
  ~ScriptedBus() override { ::close(fd_); }
  ScriptedBus(const ScriptedBus&) = delete;
  ScriptedBus& operator=(const ScriptedBus&) = delete;

  void arrive(int stamp, std::uint32_t id = 1) {
    CanFrame frame;
    frame.stamp = Timestamp(std::chrono::nanoseconds(stamp));
    frame.id = id;
    waiting.push_back(frame);
    const std::uint64_t one = 1;
    ASSERT_EQ(::write(fd_, &one, sizeof one), 8);
  }

  bool send(const CanFrame& frame) noexcept override {
    if (must_refuse) return false;
    if (sent_count < sent.size()) sent[sent_count] = frame;
    ++sent_count;
    return true;
  }
  ReceiveResult receive(std::span<CanFrame> out, std::chrono::nanoseconds) noexcept override {
    ++receive_calls;
    if (status_once != ReceiveStatus::kTimeout) {
      const ReceiveStatus status = status_once;
      status_once = ReceiveStatus::kTimeout;
      return {status, 0};
    }
    std::size_t count = 0;
    while (count < out.size() && next < waiting.size()) out[count++] = waiting[next++];
    if (next == waiting.size()) {
      std::uint64_t value = 0;
      static_cast<void>(::read(fd_, &value, sizeof value));
    }
    received += count;
    return {count > 0 ? ReceiveStatus::kOk : ReceiveStatus::kTimeout, count};
  }
  void set_filters(std::span<const IdFilter> filters) override { filter_count = filters.size(); }
  [[nodiscard]] int readiness_fd() const noexcept override { return fd_; }
  [[nodiscard]] BusCounters counters() const noexcept override {
    return {.sent = sent_count, .received = received, .dropped = 7, .outages = 1};
  }
  [[nodiscard]] bool is_up() const noexcept override { return up; }
  [[nodiscard]] int last_error() const noexcept override { return error; }
  [[nodiscard]] std::string name() const override { return name_; }

  std::vector<CanFrame> waiting;
  std::size_t next = 0;
  std::array<CanFrame, 64> sent;
  std::size_t sent_count = 0, received = 0, filter_count = 99;
  int receive_calls = 0;
  int error = 0;
  bool up = true;
  bool must_refuse = false;
  ReceiveStatus status_once = ReceiveStatus::kTimeout;

 private:
  std::string name_;
  int fd_ = ::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
};

class BusGroupTest : public testing::Test {
 protected:
  BusGroupTest() {
    std::vector<std::unique_ptr<CanBus>> members;
    for (ScriptedBus*& bus : buses) {
      auto member = std::make_unique<ScriptedBus>("bus" + std::to_string(members.size()));
      bus = member.get();
      members.push_back(std::move(member));
    }
    group = std::make_unique<BusGroup>(std::move(members));
  }

  std::array<ScriptedBus*, 3> buses{};
  std::unique_ptr<BusGroup> group;
  std::array<CanFrame, BusGroup::kBatch + 10> out;
};

TEST_F(BusGroupTest, TagsFramesWithTheirBusAndOrdersThemByStamp) {
  buses[2]->arrive(10);
  buses[0]->arrive(20);
  buses[1]->arrive(15);
  buses[2]->arrive(30);
  buses[0]->arrive(20);
  const ReceiveResult result = group->receive(out, 1s);
  ASSERT_EQ(result.status, ReceiveStatus::kOk);
  ASSERT_EQ(result.count, 5u);
  const std::array<int, 5> expected_bus{2, 1, 0, 0, 2};
  const std::array<int, 5> expected_stamp{10, 15, 20, 20, 30};
  for (std::size_t n = 0; n < 5; ++n) {
    EXPECT_EQ(out[n].bus, expected_bus[n]) << n;
    EXPECT_EQ(out[n].stamp.time_since_epoch().count(), expected_stamp[n]) << n;
  }
  EXPECT_EQ(group->receive(out, 0ns).status, ReceiveStatus::kTimeout);
}

TEST_F(BusGroupTest, KeepsTheOrderOfOneBusWhateverItsStamps) {
  for (const int stamp : {30, 10, 20}) buses[1]->arrive(stamp, static_cast<std::uint32_t>(stamp));
  ASSERT_EQ(group->receive(out, 0ns).count, 3u);
  EXPECT_EQ(out[0].id, 30u);
  EXPECT_EQ(out[1].id, 10u);
  EXPECT_EQ(out[2].id, 20u);
}

TEST_F(BusGroupTest, LetsAQuietBusThroughWhileAnotherFloods) {
  for (int n = 0; n < 1000; ++n) buses[0]->arrive(n);
  for (int n = 0; n < 1000; ++n) buses[1]->arrive(n);
  buses[2]->arrive(5000);
  std::array<CanFrame, 12> small;
  bool has_quiet_one = false;
  for (int round = 0; round < 2; ++round) {
    const ReceiveResult result = group->receive(small, 0ns);
    std::array<int, 3> of_bus{};
    for (std::size_t n = 0; n < result.count; ++n) ++of_bus[small[n].bus];
    has_quiet_one = has_quiet_one || of_bus[2] == 1;
    EXPECT_GE(of_bus[0], 4);
    EXPECT_GE(of_bus[1], 4);
  }
  EXPECT_TRUE(has_quiet_one);
}

TEST_F(BusGroupTest, ServesEveryBusInTurnWhereOnlyOneFrameFits) {
  for (int n = 0; n < 100; ++n) {
    for (ScriptedBus* bus : buses) bus->arrive(n);
  }
  std::array<int, 3> of_bus{};
  std::array<CanFrame, 1> one;
  for (int n = 0; n < 30; ++n) {
    ASSERT_EQ(group->receive(one, 0ns).count, 1u);
    ++of_bus[one[0].bus];
  }
  EXPECT_EQ(of_bus, (std::array<int, 3>{10, 10, 10}));
}

TEST_F(BusGroupTest, ReturnsAtMostItsBatchAndTheRestLater) {
  constexpr std::size_t kFrames = 2 * BusGroup::kBatch + 5;
  for (std::size_t n = 0; n < kFrames; ++n) buses[0]->arrive(static_cast<int>(n));
  EXPECT_EQ(group->receive(out, 0ns).count, BusGroup::kBatch);
  EXPECT_EQ(group->receive(out, 0ns).count, BusGroup::kBatch);
  EXPECT_EQ(group->receive(out, 0ns).count, 5u);
  EXPECT_EQ(group->receive({}, 0ns).status, ReceiveStatus::kTimeout);
}

TEST_F(BusGroupTest, SendsToTheBusThatAFrameNames) {
  std::array<CanFrame, 5> frames{};
  frames[0].bus = 2;
  frames[1].bus = 2;
  frames[2].bus = 0;
  frames[3].bus = 3;
  frames[4].bus = 2;
  for (std::size_t n = 0; n < frames.size(); ++n) frames[n].id = static_cast<std::uint32_t>(n);
  EXPECT_EQ(group->send_batch(frames), 4u);
  EXPECT_EQ(buses[2]->sent_count, 3u);
  EXPECT_EQ(buses[2]->sent[0].id, 0u);
  EXPECT_EQ(buses[2]->sent[1].id, 1u);
  EXPECT_EQ(buses[2]->sent[2].id, 4u);
  EXPECT_EQ(buses[0]->sent_count, 1u);
  EXPECT_EQ(buses[1]->sent_count, 0u);
  EXPECT_FALSE(group->send(frames[3]));
  EXPECT_EQ(group->counters().send_errors, 2u);
  buses[0]->must_refuse = true;
  EXPECT_FALSE(group->send(frames[2]));
}

TEST_F(BusGroupTest, AddsTheMembersCountersUpAndShowsEach) {
  buses[0]->arrive(1);
  buses[1]->arrive(2);
  static_cast<void>(group->receive(out, 0ns));
  EXPECT_EQ(group->counters().received, 2u);
  EXPECT_EQ(group->counters().dropped, 21u);
  EXPECT_EQ(group->counters().outages, 3u);
  EXPECT_EQ(group->size(), 3u);
  EXPECT_EQ(group->member(1).counters().received, 1u);
  EXPECT_EQ(group->member(2).counters().received, 0u);
  EXPECT_EQ(group->name(), "bus0,bus1,bus2");
  EXPECT_EQ(group->last_error(), 0);
  buses[1]->error = 5;
  EXPECT_EQ(group->last_error(), 5);
}

TEST_F(BusGroupTest, SetsFiltersOnEveryMember) {
  const std::array<IdFilter, 2> filters{{{1, false}, {2, false}}};
  group->set_filters(filters);
  for (const ScriptedBus* bus : buses) EXPECT_EQ(bus->filter_count, 2u);
}

TEST_F(BusGroupTest, HasADescriptorThatIsReadableWhenAMemberIs) {
  pollfd readiness{group->readiness_fd(), POLLIN, 0};
  EXPECT_EQ(::poll(&readiness, 1, 0), 0);
  buses[1]->arrive(1);
  EXPECT_EQ(::poll(&readiness, 1, 1000), 1);
  static_cast<void>(group->receive(out, 0ns));
  EXPECT_EQ(::poll(&readiness, 1, 0), 0);
}

TEST_F(BusGroupTest, WaitsAsLongAsItIsTold) {
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(group->receive(out, 30ms).status, ReceiveStatus::kTimeout);
  EXPECT_GE(std::chrono::steady_clock::now() - begin, 30ms);
  EXPECT_EQ(group->receive(out, -1s).status, ReceiveStatus::kTimeout);
}

TEST_F(BusGroupTest, SaysDownOnceWhenTheLastMemberIsDown) {
  buses[0]->up = false;
  buses[1]->up = false;
  EXPECT_TRUE(group->is_up());
  buses[2]->arrive(1);
  EXPECT_EQ(group->receive(out, 0ns).status, ReceiveStatus::kOk);
  EXPECT_EQ(group->receive(out, 1ms).status, ReceiveStatus::kTimeout);
  buses[2]->up = false;
  EXPECT_FALSE(group->is_up());
  EXPECT_EQ(group->receive(out, 1s).status, ReceiveStatus::kDown);
  EXPECT_EQ(group->receive(out, 1ms).status, ReceiveStatus::kTimeout);
  buses[1]->up = true;
  buses[1]->arrive(2);
  EXPECT_EQ(group->receive(out, 0ns).status, ReceiveStatus::kOk);
  buses[1]->up = false;
  EXPECT_EQ(group->receive(out, 1s).status, ReceiveStatus::kDown);
}

TEST_F(BusGroupTest, KeepsAskingMembersThatAreDownWhetherTheyAreBack) {
  buses[1]->up = false;
  const int calls_before = buses[1]->receive_calls;
  EXPECT_EQ(group->receive(out, 60ms).status, ReceiveStatus::kTimeout);
  EXPECT_GE(buses[1]->receive_calls - calls_before, 2);
  EXPECT_EQ(buses[0]->receive_calls, 0);
}

TEST_F(BusGroupTest, SaysErrorOnlyWhereNoOtherHasFrames) {
  buses[0]->arrive(1);
  buses[0]->status_once = ReceiveStatus::kError;
  buses[1]->arrive(2);
  EXPECT_EQ(group->receive(out, 0ns).status, ReceiveStatus::kOk);
  buses[0]->status_once = ReceiveStatus::kError;
  EXPECT_EQ(group->receive(out, 0ns).status, ReceiveStatus::kError);
}

TEST_F(BusGroupTest, DoesNotAllocateAfterConstruction) {
  std::array<CanFrame, 3> frames{};
  frames[1].bus = 1;
  frames[2].bus = 5;
  std::size_t received = 0;
  for (int n = 0; n < 1000; ++n) buses[static_cast<std::size_t>(n) % 3]->arrive(n);
  const AllocationGuard guard;
  for (int step = 0; step < 1000; ++step) {
    group->send_batch(frames);
    received += group->receive(std::span(out).first(2), 0ns).count;
  }
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(received, 1000u);
}

TEST(BusGroup, RefusesMembersThatItCannotWaitOn) {
  EXPECT_THROW(BusGroup{{}}, std::invalid_argument);
  LoopBus loop;
  std::vector<std::unique_ptr<CanBus>> members;
  members.push_back(loop.attach());
  EXPECT_THROW(BusGroup(std::move(members)), std::invalid_argument);
}

}  // namespace
}  // namespace faultline

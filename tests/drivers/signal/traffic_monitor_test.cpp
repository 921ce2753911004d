#include "drivers/signal/traffic_monitor.h"

#include <limits>
#include <map>
#include <random>
#include <tuple>

#include <gtest/gtest.h>

#include "drivers/dbc/dbc_parser.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using std::chrono::milliseconds;

constexpr std::string_view kDbc =
    "BO_ 256 Fast: 2 N\n SG_ crc : 0|8@1+ (1,0) [0|0] \"\" N\n SG_ n : 8|4@1+ (1,0) [0|0] \"\" N\n"
    "BO_ 2147484416 Far: 8 N\n SG_ s : 0|8@1+ (1,0) [0|0] \"\" N\n"
    "BO_ 257 Silent: 8 N\n SG_ t : 0|8@1+ (1,0) [0|0] \"\" N\n"
    "BA_DEF_ SG_ \"FaultlineRole\" STRING ;\nBA_DEF_ BO_ \"FaultlineProtection\" STRING ;\n"
    "BA_DEF_ BO_ \"FaultlineBus\" INT 0 255;\nBA_DEF_ BO_ \"GenMsgCycleTime\" INT 0 10000;\n"
    "BA_ \"FaultlineRole\" SG_ 256 n \"alive\";\nBA_ \"FaultlineRole\" SG_ 256 crc \"crc\";\n"
    "BA_ \"FaultlineProtection\" BO_ 256 \"J1850\";\nBA_ \"GenMsgCycleTime\" BO_ 256 10;\n"
    "BA_ \"FaultlineBus\" BO_ 2147484416 2;\n";

DbcDatabase dbc() { return parse_dbc(kDbc, "t.dbc"); }

CanFrame frame_of(std::uint32_t id, std::int64_t time_ms, std::uint8_t bus = 0,
                  bool is_extended = false) {
  CanFrame frame;
  frame.id = id;
  frame.bus = bus;
  frame.is_extended = is_extended;
  frame.length = 2;
  frame.stamp = Timestamp(milliseconds(time_ms));
  return frame;
}

/// Sends message Fast.
class Sender {
 public:
  CanFrame next(std::int64_t time_ms, std::uint8_t bus = 0) {
    CanFrame frame = frame_of(256, time_ms, bus);
    protector_.protect(frame);
    return frame;
  }

 private:
  DbcDatabase dbc_ = dbc();
  MessageProtector protector_{compile_protection(dbc_, dbc_.messages[0])};
};

SignalState state_at(const IdentifierTraffic* traffic, std::int64_t time_ms) {
  return state(*traffic, Timestamp(milliseconds(time_ms)));
}

TEST(TrafficMonitor, BeginsWithTheMessagesOfTheDbcNeverSeen) {
  const TrafficMonitor monitor(dbc());
  ASSERT_EQ(monitor.identifiers().size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(monitor.identifiers()[i].message, i);
    EXPECT_EQ(state_at(&monitor.identifiers()[i], 0), SignalState::kNeverSeen);
    EXPECT_EQ(age(monitor.identifiers()[i], Timestamp{}), std::nullopt);
  }
  EXPECT_EQ(monitor.identifiers()[1].bus, 2);
  EXPECT_TRUE(monitor.identifiers()[1].is_extended);
}

TEST(TrafficMonitor, FollowsEveryIdentifierBusAndFormatApart) {
  TrafficMonitor monitor;
  for (int i = 0; i < 3; ++i) monitor.on_frame(frame_of(5, i));
  monitor.on_frame(frame_of(5, 1, 1));
  monitor.on_frame(frame_of(5, 2, 0, true));
  EXPECT_EQ(monitor.identifiers().size(), 3U);
  EXPECT_EQ(monitor.find(0, 5, false)->frames, 3U);
  EXPECT_EQ(monitor.find(0, 5, false)->payload_bytes, 6U);
  EXPECT_EQ(monitor.find(1, 5, false)->frames, 1U);
  EXPECT_EQ(monitor.find(0, 5, true)->frames, 1U);
  EXPECT_EQ(monitor.find(1, 5, true), nullptr);
  EXPECT_EQ(monitor.frames(), 5U);
}

TEST(TrafficMonitor, TellsTheStateOfAMessage) {
  Sender sender;
  TrafficMonitor monitor(dbc());
  const IdentifierTraffic* traffic = monitor.on_frame(sender.next(0));
  EXPECT_EQ(state_at(traffic, 30), SignalState::kFresh);
  EXPECT_EQ(state_at(traffic, 31), SignalState::kStale);
  EXPECT_EQ(age(*traffic, Timestamp(milliseconds(31))), milliseconds(31));
  CanFrame broken = sender.next(10);
  broken.data[0] ^= 1;
  monitor.on_frame(broken);
  EXPECT_EQ(state_at(traffic, 10), SignalState::kCrcError);
  EXPECT_EQ(age(*traffic, Timestamp(milliseconds(10))), milliseconds(10));
  const CanFrame good = sender.next(20);
  monitor.on_frame(good);
  EXPECT_EQ(state_at(traffic, 20), SignalState::kFresh);
  monitor.on_frame(good);
  EXPECT_EQ(state_at(traffic, 20), SignalState::kCounterError);
  static_cast<void>(sender.next(30));
  monitor.on_frame(sender.next(40));
  EXPECT_EQ(traffic->last_check.status, IntegrityStatus::kCounterGap);
  EXPECT_EQ(state_at(traffic, 40), SignalState::kCounterError);
  EXPECT_EQ(traffic->integrity.counters().lost, 1U);
}

TEST(TrafficMonitor, CallsNothingStaleThatHasNoPeriod) {
  TrafficMonitor monitor;
  const IdentifierTraffic* traffic = monitor.on_frame(frame_of(9, 0));
  EXPECT_EQ(state_at(traffic, 1'000'000'000), SignalState::kFresh);
}

TEST(TrafficMonitor, KnowsAMessageOnEveryBusUnlessTheDbcSaysWhich) {
  Sender sender;
  TrafficMonitor monitor(dbc());
  const IdentifierTraffic* const other = monitor.on_frame(sender.next(0, 7));
  EXPECT_EQ(other->message, 0U);
  EXPECT_EQ(other->period.period(), milliseconds(10));
  EXPECT_TRUE(other->integrity.protection().has_crc());
  EXPECT_EQ(monitor.find(0, 256, false)->frames, 0U);
  EXPECT_EQ(monitor.on_frame(frame_of(768, 0, 0, true))->message, IdentifierTraffic::kNoMessage);
  EXPECT_EQ(monitor.on_frame(frame_of(768, 0, 2, true))->message, 1U);
}

TEST(TrafficMonitor, CountsRemoteAndErrorFramesApart) {
  TrafficMonitor monitor(dbc());
  CanFrame frame = frame_of(256, 0);
  frame.is_remote = true;
  const IdentifierTraffic* const traffic = monitor.on_frame(frame);
  EXPECT_EQ(traffic->frames, 1U);
  EXPECT_EQ(traffic->remote_frames, 1U);
  EXPECT_EQ(traffic->integrity.counters().frames, 0U);
  EXPECT_EQ(state_at(traffic, 0), SignalState::kNeverSeen);
  frame.is_remote = false;
  frame.is_error = true;
  EXPECT_EQ(monitor.on_frame(frame), nullptr);
  EXPECT_EQ(monitor.error_frames(), 1U);
  EXPECT_EQ(monitor.frames(), 2U);
}

TEST(TrafficMonitor, CountsWhatItHasNoRoomFor) {
  TrafficMonitor monitor(dbc(), 10);
  for (std::uint32_t id = 0; id < 100; ++id) monitor.on_frame(frame_of(id, id));
  EXPECT_EQ(monitor.identifiers().size(), 13U);
  EXPECT_EQ(monitor.untracked_frames(), 90U);
  EXPECT_NE(monitor.on_frame(frame_of(256, 0)), nullptr);  // of the DBC
  EXPECT_NE(monitor.on_frame(frame_of(9, 0)), nullptr);    // seen before
  EXPECT_EQ(monitor.on_frame(frame_of(10, 0)), nullptr);
}

TEST(TrafficMonitor, HasNoRoomAtAllIfAskedToHaveNone) {
  TrafficMonitor monitor(DbcDatabase{}, 0);
  EXPECT_EQ(monitor.on_frame(frame_of(1, 0)), nullptr);
  EXPECT_EQ(monitor.find(0, 1, false), nullptr);
}

TEST(TrafficMonitor, TakesTheFirstOfTwoMessagesWithOneIdentifier) {
  const TrafficMonitor monitor(
      parse_dbc("BO_ 1 A: 8 N\n\nBO_ 1 B: 8 N\n SG_ s : 0|8@1+ (1,0) [0|0] \"\" N\n", "t.dbc"));
  EXPECT_EQ(monitor.identifiers().size(), 1U);
  EXPECT_EQ(monitor.find(0, 1, false)->message, 0U);
}

TEST(TrafficMonitor, SurvivesStampsFromTheEndsOfTime) {
  Sender sender;
  TrafficMonitor monitor(dbc());
  CanFrame frame = sender.next(0);
  frame.stamp = Timestamp(std::chrono::nanoseconds(std::numeric_limits<std::int64_t>::min()));
  const IdentifierTraffic* const traffic = monitor.on_frame(frame);
  const Timestamp last(std::chrono::nanoseconds(std::numeric_limits<std::int64_t>::max()));
  EXPECT_EQ(state(*traffic, last), SignalState::kStale);
  EXPECT_EQ(age(*traffic, last), std::chrono::nanoseconds::max());
}

TEST(TrafficMonitor, AgreesWithAMapOnRandomTraffic) {
  const std::uint64_t seed = test_seed(11);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937 draw(static_cast<std::uint32_t>(seed));
  std::map<std::tuple<int, std::uint32_t, bool>, std::uint64_t> expected;
  TrafficMonitor monitor(DbcDatabase{}, 20'000);
  for (int i = 0; i < 20'000; ++i) {
    const bool is_extended = draw() % 2 == 0;
    // Identifiers that lie together, and those that differ in high bits alone.
    const auto id =
        static_cast<std::uint32_t>(is_extended ? (draw() % 64) << (draw() % 24) : draw() % 2048);
    const auto bus = static_cast<std::uint8_t>(draw() % 3);
    ++expected[{bus, id, is_extended}];
    ASSERT_NE(monitor.on_frame(frame_of(id, i, bus, is_extended)), nullptr);
  }
  EXPECT_EQ(monitor.identifiers().size(), expected.size());
  for (const auto& [key, frames] : expected) {
    const IdentifierTraffic* const traffic = monitor.find(
        static_cast<std::uint8_t>(std::get<0>(key)), std::get<1>(key), std::get<2>(key));
    ASSERT_NE(traffic, nullptr);
    EXPECT_EQ(traffic->frames, frames);
  }
}

TEST(TrafficMonitor, DoesNotAllocateWhateverItSees) {
  TrafficMonitor monitor(dbc(), 500);
  const AllocationGuard guard;
  for (std::uint32_t i = 0; i < 5000; ++i) monitor.on_frame(frame_of(i * 7 % 1000, i, i % 2));
  EXPECT_EQ(guard.heap_calls(), 0U);
  EXPECT_GT(monitor.untracked_frames(), 0U);
}

TEST(TrafficMonitor, RefusesAProtectionThatIsDescribedWrongly) {
  EXPECT_THROW(TrafficMonitor(parse_dbc(
                   std::string(kDbc) + "BA_ \"FaultlineProtection\" BO_ 256 \"E2E\";\n", "t.dbc")),
               ProtectionError);
}

}  // namespace
}  // namespace faultline

#include "drivers/signal/sampler.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "drivers/dbc/dbc_parser.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

constexpr std::string_view kMessages =
    "BO_ 1 Sync: 8 P\n"
    " SG_ k : 0|32@1+ (1,0) [0|0] \"\" C\n"
    " SG_ c : 32|32@1+ (1,0) [0|0] \"\" C\n"
    "BO_ 2 A: 8 P\n"
    " SG_ y1 : 0|16@1- (1,0) [0|0] \"\" C\n"
    " SG_ y2 : 16|16@1- (1,0) [0|0] \"\" C\n"
    " SG_ k_a : 32|4@1+ (1,0) [0|0] \"\" C\n"
    "BO_ 3 B: 8 P\n"
    " SG_ y3 : 0|32@1- (1,0) [0|0] \"\" C\n"
    " SG_ k_b : 32|8@1+ (1,0) [0|0] \"\" C\n"
    "BO_ 4 U: 8 C\n"
    " SG_ u1 : 0|16@1- (1,0) [0|0] \"\" P\n"
    " SG_ k_u : 32|4@1+ (1,0) [0|0] \"\" P\n"
    "BO_ 5 V: 8 C\n"
    " SG_ u2 : 0|16@1- (1,0) [0|0] \"\" P\n"
    " SG_ k_v : 32|4@1+ (1,0) [0|0] \"\" P\n"
    "SIG_VALTYPE_ 3 y3 : 1;\n"
    "BA_DEF_ SG_ \"FaultlineRole\" STRING ;\n"
    "BA_DEF_DEF_ \"FaultlineRole\" \"\";\n";

constexpr std::string_view kSyncRole = "BA_ \"FaultlineRole\" SG_ 1 k \"sync\";\n";
constexpr std::string_view kCommandCycleRole = "BA_ \"FaultlineRole\" SG_ 1 c \"command_cycle\";\n";
constexpr std::string_view kSensorCycleRoles =
    "BA_ \"FaultlineRole\" SG_ 2 k_a \"cycle\";\nBA_ \"FaultlineRole\" SG_ 3 k_b \"cycle\";\n";
constexpr std::string_view kCommandCycleRoles =
    "BA_ \"FaultlineRole\" SG_ 4 k_u \"cycle\";\nBA_ \"FaultlineRole\" SG_ 5 k_v \"cycle\";\n";

SignalMap map_with(std::initializer_list<std::string_view> roles) {
  std::string text(kMessages);
  for (const std::string_view role : roles) text += role;
  return make_signal_map(parse_dbc(text, "unit.dbc"), {"y1", "y2", "y3"}, {"u1", "u2"});
}

SignalMap full_map() {
  return map_with({kSyncRole, kCommandCycleRole, kSensorCycleRoles, kCommandCycleRoles});
}

// What the unit measures in cycle k, and what command c says.
std::array<double, 3> y_of(std::uint32_t k) {
  const double base = k % 10'000;
  return {base + 1, -base, 0.5 * base};
}
std::array<double, 2> u_of(std::uint32_t c) {
  const double base = c % 10'000;
  return {base + 0.0, -2.0 * base};
}

/// What a sample says, by value.
struct Seen {
  std::uint32_t cycle = 0;
  std::uint32_t command_cycle = 0;
  std::uint32_t flags = 0;
  std::vector<double> y, u;
  std::vector<std::uint8_t> y_is_fresh, u_is_fresh;
  Timestamp stamp;

  bool operator==(const Seen& other) const {
    return cycle == other.cycle && command_cycle == other.command_cycle && flags == other.flags &&
           y == other.y && u == other.u && y_is_fresh == other.y_is_fresh &&
           u_is_fresh == other.u_is_fresh;
  }
};

/// A plant and a controller as seen on the bus, and the sampler that listens.
class Listener {
 public:
  explicit Listener(SignalMap map = full_map()) : map_(std::move(map)), sampler(map_) {}

  [[nodiscard]] CanFrame sync_frame(std::uint32_t k, std::uint32_t c_k) const {
    CanFrame frame;
    map_.sync->encode(k, c_k, frame);
    return frame;
  }
  [[nodiscard]] CanFrame sensor_frame(std::size_t message, std::uint32_t k) const {
    CanFrame frame;
    map_.sensor_messages[message].encode(y_of(k), k, frame);
    return frame;
  }
  [[nodiscard]] CanFrame command_frame(std::size_t message, std::uint32_t c) const {
    CanFrame frame;
    map_.command_messages[message].encode(u_of(c), c, frame);
    return frame;
  }

  void push(CanFrame frame) {
    frame.stamp = Timestamp(std::chrono::nanoseconds(++pushed_));
    sampler.push(frame);
    take_all();
  }
  void sync(std::uint32_t k, std::uint32_t c_k) { push(sync_frame(k, c_k)); }
  void sensor(std::size_t message, std::uint32_t k) { push(sensor_frame(message, k)); }
  void command(std::size_t message, std::uint32_t c) { push(command_frame(message, c)); }
  void sensors(std::uint32_t k) {
    sensor(0, k);
    sensor(1, k);
  }
  void commands(std::uint32_t c) {
    command(0, c);
    command(1, c);
  }
  /// Cycle k as a healthy unit does it: command k-1 acts, command k is answered.
  void cycle(std::uint32_t k) {
    sync(k, k - 1);
    sensors(k);
    commands(k);
  }
  /// Listens from `k` on until a good sample has come.
  void join_at(std::uint32_t k) {
    sync(k, kNoCommand);
    sensors(k);
    commands(k);
    ASSERT_EQ(seen.size(), 1u);
    ASSERT_EQ(seen[0].flags, 0u);
    seen.clear();
  }
  void finish() {
    sampler.finish();
    take_all();
  }

  std::vector<Seen> seen;

 private:
  void take_all() {
    while (const Sample* sample = sampler.take()) {
      seen.push_back({sample->cycle,
                      sample->command_cycle,
                      sample->flags,
                      {sample->y.begin(), sample->y.end()},
                      {sample->u.begin(), sample->u.end()},
                      {sample->y_is_fresh.begin(), sample->y_is_fresh.end()},
                      {sample->u_is_fresh.begin(), sample->u_is_fresh.end()},
                      sample->stamp});
    }
  }

  SignalMap map_;
  std::int64_t pushed_ = 0;

 public:
  Sampler sampler;
};

std::vector<double> values(const auto& array) { return {array.begin(), array.end()}; }

void expect_whole(const Seen& sample, std::uint32_t k, std::uint32_t c_k) {
  EXPECT_EQ(sample.cycle, k);
  EXPECT_EQ(sample.command_cycle, c_k);
  EXPECT_EQ(sample.flags & kBadSample, 0u) << "cycle " << k;
  EXPECT_EQ(sample.y, values(y_of(k)));
  EXPECT_EQ(sample.u, values(u_of(c_k)));
  EXPECT_EQ(sample.y_is_fresh, (std::vector<std::uint8_t>{1, 1, 1}));
  EXPECT_EQ(sample.u_is_fresh, (std::vector<std::uint8_t>{1, 1}));
}

// --- The cycle --------------------------------------------------------------------------------

TEST(Sampler, ClosesASampleWhenTheLastFrameArrives) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensor(1, 1);
  EXPECT_TRUE(listener.seen.empty());
  listener.sensor(0, 1);
  ASSERT_EQ(listener.seen.size(), 1u);
  expect_whole(listener.seen[0], 1, 0);
}

TEST(Sampler, StampsASampleWithTheFrameThatClosedIt) {
  Listener listener;
  listener.sync(0, kNoCommand);
  listener.sensor(0, 0);
  listener.sensor(1, 0);
  ASSERT_EQ(listener.seen.size(), 1u);
  EXPECT_EQ(listener.seen[0].stamp, Timestamp(std::chrono::nanoseconds(3)));
}

TEST(Sampler, TakesTheInputsForZeroBeforeTheFirstCommand) {
  Listener listener;
  listener.sync(0, kNoCommand);
  listener.sensors(0);
  ASSERT_EQ(listener.seen.size(), 1u);
  EXPECT_EQ(listener.seen[0].flags, 0u);
  EXPECT_EQ(listener.seen[0].u, (std::vector<double>{0.0, 0.0}));
  EXPECT_EQ(listener.seen[0].u_is_fresh, (std::vector<std::uint8_t>{1, 1}));
  EXPECT_EQ(listener.seen[0].command_cycle, kNoCommand);
}

TEST(Sampler, TakesTheSensorsBeforeTheSync) {
  Listener listener;
  listener.join_at(0);
  listener.sensors(1);
  EXPECT_TRUE(listener.seen.empty());
  listener.sync(1, 0);
  ASSERT_EQ(listener.seen.size(), 1u);
  expect_whole(listener.seen[0], 1, 0);
}

TEST(Sampler, WaitsForACommandThatComesAfterTheSensors) {
  Listener listener;
  listener.sync(0, kNoCommand);
  listener.sensors(0);
  listener.command(0, 0);
  listener.sync(1, 0);
  listener.sensors(1);
  EXPECT_EQ(listener.seen.size(), 1u);
  listener.command(1, 0);
  ASSERT_EQ(listener.seen.size(), 2u);
  expect_whole(listener.seen[1], 1, 0);
}

TEST(Sampler, TakesTheCommandThatTheSyncNamesAndNotTheNewest) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensors(1);
  listener.commands(1);
  listener.sync(2, 0);  // the plant had not seen command 1 yet
  listener.sensors(2);
  ASSERT_EQ(listener.seen.size(), 2u);
  expect_whole(listener.seen[1], 2, 0);
}

TEST(Sampler, KeepsTheCommandOfAControllerThatDiedForEver) {
  Listener listener;
  listener.join_at(0);
  for (std::uint32_t k = 1; k < 500; ++k) {
    listener.sync(k, 0);
    listener.sensors(k);
  }
  ASSERT_EQ(listener.seen.size(), 499u);
  for (const Seen& sample : listener.seen) expect_whole(sample, sample.cycle, 0);
}

TEST(Sampler, FindsACommandEightCountersOld) {
  Listener listener;
  listener.join_at(0);
  for (std::uint32_t k = 1; k < 40; ++k) {
    listener.sync(k, k <= 8 ? 0 : k - 8);
    listener.sensors(k);
    listener.commands(k);
  }
  ASSERT_EQ(listener.seen.size(), 39u);
  for (const Seen& sample : listener.seen) {
    expect_whole(sample, sample.cycle, sample.cycle <= 8 ? 0 : sample.cycle - 8);
  }
}

TEST(Sampler, CountsOnWhenTheCycleWrapsAtThirtyTwoBits) {
  constexpr std::uint32_t kFirst = 0xFFFF'FFFFu - 20;
  Listener listener;
  listener.join_at(kFirst);
  std::uint32_t k = kFirst;
  for (int n = 0; n < 40; ++n) {
    ++k;
    // c_k = 0xFFFFFFFF means "none": the plant skips that counter.
    listener.sync(k, k - 1 == kNoCommand ? k - 2 : k - 1);
    listener.sensors(k);
    listener.commands(k);
  }
  ASSERT_EQ(listener.seen.size(), 40u);
  for (const Seen& sample : listener.seen) EXPECT_EQ(sample.flags, 0u) << sample.cycle;
  EXPECT_EQ(listener.seen.back().cycle, 19u);
  EXPECT_EQ(listener.sampler.counters().resets, 0u);
}

TEST(Sampler, IgnoresFramesOfOthers) {
  Listener listener;
  CanFrame other;
  other.id = 0x99;
  listener.push(other);
  CanFrame remote = listener.sensor_frame(0, 0);
  remote.is_remote = true;
  listener.push(remote);
  EXPECT_EQ(listener.sampler.counters().ignored_frames, 2u);
}

// --- What goes wrong --------------------------------------------------------------------------

TEST(Sampler, ClosesAtTheFirstFrameTwoCyclesLaterAndSaysWhatIsMissing) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensor(0, 1);  // the other one is lost
  listener.commands(1);
  listener.sync(2, 1);
  listener.sensors(2);
  EXPECT_TRUE(listener.seen.empty());
  listener.sensor(0, 3);
  ASSERT_EQ(listener.seen.size(), 2u);
  const Seen& bad = listener.seen[0];
  EXPECT_EQ(bad.cycle, 1u);
  EXPECT_EQ(bad.flags, kSampleSensorMissing);
  EXPECT_EQ(bad.y, (std::vector<double>{y_of(1)[0], y_of(1)[1], y_of(0)[2]}));  // y3 is held
  EXPECT_EQ(bad.y_is_fresh, (std::vector<std::uint8_t>{1, 1, 0}));
  EXPECT_EQ(bad.u, values(u_of(0)));
  expect_whole(listener.seen[1], 2, 1);
  EXPECT_EQ(listener.sampler.counters().missing_messages, 1u);
  EXPECT_EQ(listener.sampler.counters().bad_samples, 1u);
}

TEST(Sampler, SaysThatTheCommandIsMissingWhenItIsIncomplete) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensors(1);
  listener.command(0, 1);  // u2 is lost
  listener.sync(2, 1);
  listener.sensors(2);
  listener.commands(2);
  listener.sync(3, 2);
  listener.sensors(3);
  listener.sync(4, 2);
  ASSERT_EQ(listener.seen.size(), 3u);
  EXPECT_EQ(listener.seen[1].flags, kSampleCommandMissing);
  EXPECT_EQ(listener.seen[1].u, (std::vector<double>{u_of(1)[0], u_of(0)[1]}));
  EXPECT_EQ(listener.seen[1].u_is_fresh, (std::vector<std::uint8_t>{1, 0}));
  expect_whole(listener.seen[2], 3, 2);
}

TEST(Sampler, SaysThatTheCommandIsMissingWhenTheSyncIsLost) {
  Listener listener;
  listener.join_at(0);
  listener.sensors(1);
  listener.commands(1);
  listener.cycle(2);
  listener.cycle(3);
  ASSERT_EQ(listener.seen.size(), 3u);
  EXPECT_EQ(listener.seen[0].flags, kSampleCommandMissing);
  EXPECT_EQ(listener.seen[0].y, values(y_of(1)));
  expect_whole(listener.seen[1], 2, 1);
}

TEST(Sampler, GivesOneBadSamplePerCycleJumpedOver) {
  Listener listener;
  listener.join_at(0);
  listener.cycle(1);
  listener.sync(5, kNoCommand);
  listener.sensors(5);
  listener.sync(6, kNoCommand);
  listener.sensors(6);
  ASSERT_EQ(listener.seen.size(), 6u);
  for (std::uint32_t k = 2; k <= 4; ++k) {
    EXPECT_EQ(listener.seen[k - 1].cycle, k);
    EXPECT_EQ(listener.seen[k - 1].flags, kSampleGap);
    EXPECT_EQ(listener.seen[k - 1].y, values(y_of(1)));
    EXPECT_EQ(listener.seen[k - 1].y_is_fresh, (std::vector<std::uint8_t>{0, 0, 0}));
  }
  EXPECT_EQ(listener.seen[4].flags, 0u);
  EXPECT_EQ(listener.sampler.counters().missing_messages, 9u);
}

TEST(Sampler, BridgesAGapOfTheLargestSize) {
  Listener listener;
  listener.join_at(0);
  const std::uint32_t k = Sampler::kMaxGap;
  listener.sync(k, kNoCommand);
  listener.sensors(k);
  listener.sync(k + 1, kNoCommand);
  listener.sensors(k + 1);
  ASSERT_EQ(listener.seen.size(), k + 1);
  for (std::uint32_t n = 0; n + 2 < k; ++n) EXPECT_EQ(listener.seen[n].flags, kSampleGap);
  EXPECT_EQ(listener.seen[k].flags, 0u);
  EXPECT_EQ(listener.sampler.counters().resets, 0u);
}

TEST(Sampler, ResetsAfterALargerGap) {
  Listener listener;
  listener.join_at(0);
  const std::uint32_t k = Sampler::kMaxGap + 1;
  listener.sync(k, kNoCommand);
  listener.sensors(k);
  ASSERT_EQ(listener.seen.size(), 1u);
  EXPECT_EQ(listener.seen[0].cycle, k);
  EXPECT_EQ(listener.seen[0].flags, kSampleReset);
  EXPECT_EQ(listener.sampler.counters().resets, 1u);
  listener.commands(k);
  listener.cycle(k + 1);
  expect_whole(listener.seen[1], k + 1, k);
}

TEST(Sampler, ResetsWhenThePlantStartsAgain) {
  Listener listener;
  listener.join_at(5000);
  listener.sync(5001, 5000);  // and then the plant restarts
  listener.sync(0, kNoCommand);
  listener.sensors(0);
  listener.commands(0);
  listener.cycle(1);
  ASSERT_EQ(listener.seen.size(), 2u);
  EXPECT_EQ(listener.seen[0].cycle, 0u);
  EXPECT_EQ(listener.seen[0].flags, kSampleReset);
  expect_whole(listener.seen[1], 1, 0);
}

TEST(Sampler, DoesNotResetForASyncWithinTheBound) {
  Listener listener;
  listener.join_at(100);
  for (std::uint32_t k = 101; k <= 110; ++k) listener.cycle(k);
  listener.sync(110 - Sampler::kMaxBack, 100);
  EXPECT_EQ(listener.sampler.counters().resets, 0u);
  EXPECT_EQ(listener.sampler.counters().late_frames, 1u);
  listener.sync(110 - Sampler::kMaxBack - 1, 100);
  EXPECT_EQ(listener.sampler.counters().resets, 1u);
}

TEST(Sampler, MarksTheNextSampleWhenAFrameComesTooLate) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensor(0, 1);
  listener.commands(1);
  listener.cycle(2);
  listener.sync(3, 2);    // closes cycle 1
  listener.sensor(1, 1);  // and now its other sensor frame
  listener.sensors(3);
  ASSERT_EQ(listener.seen.size(), 3u);
  EXPECT_EQ(listener.seen[0].flags, kSampleSensorMissing);
  EXPECT_EQ(listener.seen[1].flags, 0u);
  EXPECT_EQ(listener.seen[2].flags, kSampleLate);
  EXPECT_EQ(listener.sampler.counters().late_frames, 1u);
}

TEST(Sampler, CountsACommandThatComesAfterItsTurn) {
  Listener listener;
  listener.join_at(0);
  for (std::uint32_t k = 1; k <= 3; ++k) {
    listener.sync(k, k - 1);
    listener.sensors(k);
    if (k != 1) listener.commands(k);
  }
  listener.cycle(4);
  EXPECT_EQ(listener.sampler.counters().late_frames, 0u);
  listener.command(0, 1);
  EXPECT_EQ(listener.sampler.counters().late_frames, 1u);
  listener.cycle(5);
  EXPECT_EQ(listener.seen.back().flags, kSampleLate);
}

TEST(Sampler, MarksASampleOfWhichAFrameCameTwiceAndKeepsTheFirst) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensor(0, 1);
  CanFrame other_content = listener.sensor_frame(0, 1);
  other_content.data[0] ^= 0xFF;
  listener.push(other_content);
  listener.sensor(1, 1);
  ASSERT_EQ(listener.seen.size(), 1u);
  EXPECT_EQ(listener.seen[0].flags, kSampleRepeated);
  EXPECT_EQ(listener.seen[0].y, values(y_of(1)));
  EXPECT_EQ(listener.sampler.counters().repeated_frames, 1u);
}

TEST(Sampler, MarksTheSampleOfARepeatedSync) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sync(1, 0);
  listener.sensors(1);
  ASSERT_EQ(listener.seen.size(), 1u);
  EXPECT_EQ(listener.seen[0].flags, kSampleRepeated);
}

TEST(Sampler, MarksOneSampleOfARepeatedCommand) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensors(1);
  listener.commands(1);
  listener.command(0, 1);
  for (std::uint32_t k = 2; k <= 4; ++k) {
    listener.sync(k, 1);
    listener.sensors(k);
  }
  ASSERT_EQ(listener.seen.size(), 4u);
  EXPECT_EQ(listener.seen[1].flags, kSampleRepeated);
  EXPECT_EQ(listener.seen[2].flags, 0u);
}

TEST(Sampler, MarksASampleWithAShortPayloadAndHoldsItsValues) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensor(0, 1);
  CanFrame truncated = listener.sensor_frame(1, 1);
  truncated.length = 3;
  listener.push(truncated);  // not even its cycle is there
  listener.commands(1);
  listener.cycle(2);
  listener.cycle(3);
  ASSERT_EQ(listener.seen.size(), 3u);
  EXPECT_EQ(listener.seen[0].flags, kSampleSensorMissing | kSampleShortPayload);
  EXPECT_EQ(listener.seen[0].y[2], y_of(0)[2]);
  EXPECT_EQ(listener.seen[1].flags, 0u);
  EXPECT_EQ(listener.sampler.counters().short_frames, 1u);
}

TEST(Sampler, MarksASampleWhoseSyncIsShort) {
  Listener listener;
  listener.join_at(0);
  CanFrame truncated = listener.sync_frame(1, 0);
  truncated.length = 4;
  listener.push(truncated);
  listener.sensors(1);
  listener.commands(1);
  listener.cycle(2);
  listener.cycle(3);
  ASSERT_EQ(listener.seen.size(), 3u);
  EXPECT_EQ(listener.seen[0].flags, kSampleCommandMissing | kSampleShortPayload);
}

TEST(Sampler, HoldsAValueThatIsNotFinite) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensor(0, 1);
  CanFrame infinite = listener.sensor_frame(1, 1);
  infinite.data[2] = 0x80;
  infinite.data[3] = 0x7F;  // +infinity
  infinite.data[0] = infinite.data[1] = 0;
  listener.push(infinite);
  ASSERT_EQ(listener.seen.size(), 1u);
  EXPECT_EQ(listener.seen[0].flags, kSampleNotFinite);
  EXPECT_EQ(listener.seen[0].y[2], y_of(0)[2]);
  EXPECT_EQ(listener.seen[0].y_is_fresh, (std::vector<std::uint8_t>{1, 1, 0}));
  EXPECT_EQ(listener.sampler.counters().not_finite_frames, 1u);
}

// --- Begin and end ----------------------------------------------------------------------------

TEST(Sampler, StartsAtTheFirstSync) {
  Listener listener;
  listener.sensors(41);
  listener.commands(41);
  EXPECT_EQ(listener.sampler.counters().ignored_frames, 4u);
  listener.sync(42, kNoCommand);
  listener.sensors(42);
  ASSERT_EQ(listener.seen.size(), 1u);
  EXPECT_EQ(listener.seen[0].cycle, 42u);
}

TEST(Sampler, StartsWithTheFirstCompleteCycleWhenItJoinsInTheMiddleOfARun) {
  Listener listener;
  listener.sensor(1, 41);
  listener.commands(41);  // c_42, before the first SYNC
  for (std::uint32_t k = 42; k < 46; ++k) listener.cycle(k);
  ASSERT_EQ(listener.seen.size(), 3u);
  for (std::uint32_t n = 0; n < 3; ++n) expect_whole(listener.seen[n], 43 + n, 42 + n);
  EXPECT_EQ(listener.sampler.counters().unstarted_cycles, 1u);
  EXPECT_EQ(listener.sampler.counters().bad_samples, 0u);
}

TEST(Sampler, DoesNotWaitForEverForACompleteFirstCycle) {
  Listener listener;
  for (std::uint32_t k = 0; k < 6; ++k) {
    listener.sync(k, kNoCommand);
    listener.sensor(0, k);  // the other message never comes
  }
  ASSERT_EQ(listener.seen.size(), 2u);
  EXPECT_EQ(listener.seen[0].cycle, Sampler::kJoinCycles);
  EXPECT_EQ(listener.seen[0].flags, kSampleSensorMissing);
}

TEST(Sampler, ClosesWhatIsOpenAtTheEnd) {
  Listener listener;
  listener.join_at(0);
  listener.sync(1, 0);
  listener.sensor(0, 1);
  listener.sync(2, 0);
  listener.sensors(2);
  EXPECT_TRUE(listener.seen.empty());
  listener.finish();
  ASSERT_EQ(listener.seen.size(), 2u);
  EXPECT_EQ(listener.seen[0].flags, kSampleSensorMissing);
  expect_whole(listener.seen[1], 2, 0);
  listener.sync(3, 0);
  EXPECT_EQ(listener.seen.size(), 2u);
  EXPECT_EQ(listener.sampler.counters().ignored_frames, 1u);
}

TEST(Sampler, GivesNothingAtTheEndOfNothing) {
  Listener listener;
  listener.finish();
  EXPECT_TRUE(listener.seen.empty());
}

TEST(Sampler, IsAsNewAfterReset) {
  const auto run = [](Listener& listener) {
    listener.sync(0, kNoCommand);
    for (std::uint32_t k = 0; k < 20; ++k) {
      if (k != 7) listener.sensor(0, k);
      listener.sensor(1, k);
      listener.commands(k);
      listener.sync(k + 1, k);
    }
    listener.finish();
    return std::exchange(listener.seen, {});
  };
  Listener listener;
  const std::vector<Seen> first = run(listener);
  listener.sampler.reset();
  EXPECT_EQ(listener.sampler.counters().samples, 0u);
  EXPECT_EQ(run(listener), first);
  EXPECT_EQ(first.size(), 21u);
}

// --- Bus order --------------------------------------------------------------------------------

TEST(SamplerInBusOrder, TakesCommandsSeenBeforeTheFirstSensorFrameOfTheCycle) {
  Listener listener(map_with({kSyncRole, kSensorCycleRoles}));  // SYNC, but no c_k
  listener.sync(0, 0);
  listener.sensors(0);
  listener.commands(3);
  listener.sync(1, 0);
  listener.sensor(0, 1);
  listener.commands(4);  // too late for cycle 1
  listener.sensor(1, 1);
  listener.sync(2, 0);
  listener.sensors(2);
  listener.sync(3, 0);
  listener.sensors(3);
  ASSERT_EQ(listener.seen.size(), 4u);
  for (const Seen& sample : listener.seen) EXPECT_EQ(sample.flags, kSampleBusOrder);
  EXPECT_EQ(listener.seen[0].u, (std::vector<double>{0.0, 0.0}));
  EXPECT_EQ(listener.seen[1].u, values(u_of(3)));
  EXPECT_EQ(listener.seen[1].y, values(y_of(1)));
  EXPECT_EQ(listener.seen[1].u_is_fresh, (std::vector<std::uint8_t>{1, 1}));
  EXPECT_EQ(listener.seen[2].u, values(u_of(4)));
  EXPECT_EQ(listener.seen[3].u, values(u_of(4)));  // held: a slower controller is no defect
  EXPECT_EQ(listener.seen[3].u_is_fresh, (std::vector<std::uint8_t>{0, 0}));
}

TEST(SamplerInBusOrder, CountsCyclesByTheSensorsWithoutSync) {
  Listener listener(map_with({kSensorCycleRoles}));
  for (std::uint32_t k = 12; k < 59; ++k) {
    listener.sensor(k % 2, k);
    listener.sensor(1 - k % 2, k);
    listener.commands(k);
  }
  ASSERT_EQ(listener.seen.size(), 47u);
  for (std::uint32_t n = 0; n < 47; ++n) {
    EXPECT_EQ(listener.seen[n].cycle, n + 12);
    EXPECT_EQ(listener.seen[n].flags, kSampleBusOrder);
    EXPECT_EQ(listener.seen[n].y, values(y_of(n + 12)));
    if (n > 0) {
      EXPECT_EQ(listener.seen[n].u, values(u_of(n + 11)));
    }
  }
}

TEST(SamplerInBusOrder, CountsForItselfWithoutAnyCounter) {
  Listener listener(map_with({}));
  for (std::uint32_t k = 0; k < 5; ++k) {
    listener.sensors(k);
    listener.commands(k);
  }
  ASSERT_EQ(listener.seen.size(), 5u);
  for (std::uint32_t k = 0; k < 5; ++k) {
    EXPECT_EQ(listener.seen[k].cycle, k);
    EXPECT_EQ(listener.seen[k].flags, kSampleBusOrder);
    EXPECT_EQ(listener.seen[k].y, values(y_of(k)));
  }
  EXPECT_EQ(listener.seen[4].u, values(u_of(3)));
}

TEST(SamplerInBusOrder, EndsACycleWhenASensorMessageComesAgain) {
  Listener listener(map_with({}));
  listener.sensors(0);
  listener.sensor(0, 1);  // the other one is lost
  listener.sensor(0, 2);
  listener.sensor(1, 2);
  ASSERT_EQ(listener.seen.size(), 3u);
  EXPECT_EQ(listener.seen[1].flags, kSampleBusOrder | kSampleSensorMissing);
  EXPECT_EQ(listener.seen[2].flags, kSampleBusOrder);
  EXPECT_EQ(listener.seen[2].y, values(y_of(2)));
}

TEST(SamplerInBusOrder, SaysWhenOnlyPartOfTheCommandsHasEverCome) {
  Listener listener(map_with({kSyncRole, kSensorCycleRoles}));
  listener.sync(0, 0);
  listener.sensors(0);
  listener.command(0, 0);
  listener.sync(1, 0);
  listener.sensors(1);
  ASSERT_EQ(listener.seen.size(), 2u);
  EXPECT_EQ(listener.seen[0].flags, kSampleBusOrder);
  EXPECT_EQ(listener.seen[1].flags, kSampleBusOrder | kSampleCommandMissing);
}

TEST(SamplerInBusOrder, TakesSensorsWithoutCounterForTheNewestSyncs) {
  Listener listener(map_with({kSyncRole, kCommandCycleRole, kCommandCycleRoles}));
  listener.sync(0, kNoCommand);
  listener.sensors(0);
  listener.commands(0);
  listener.cycle(1);
  ASSERT_EQ(listener.seen.size(), 2u);
  EXPECT_EQ(listener.seen[1].flags, kSampleBusOrder);
  EXPECT_EQ(listener.seen[1].y, values(y_of(1)));
  EXPECT_EQ(listener.seen[1].u, values(u_of(0)));
}

// --- At random --------------------------------------------------------------------------------

/// A frame and when it comes, in cycles.
struct TimedFrame {
  double time = 0.0;
  std::uint32_t cycle = 0;
  bool is_command = false;
  CanFrame frame;
};

std::vector<TimedFrame> healthy_run(const Listener& listener, std::uint32_t first,
                                    std::uint32_t count) {
  std::vector<TimedFrame> run;
  for (std::uint32_t n = 0; n < count; ++n) {
    const std::uint32_t k = first + n;
    run.push_back({n + 0.0, k, false, listener.sync_frame(k, n == 0 ? kNoCommand : k - 1)});
    run.push_back({n + 0.1, k, false, listener.sensor_frame(0, k)});
    run.push_back({n + 0.2, k, false, listener.sensor_frame(1, k)});
    run.push_back({n + 0.3, k, true, listener.command_frame(0, k)});
    run.push_back({n + 0.4, k, true, listener.command_frame(1, k)});
  }
  return run;
}

TEST(SamplerAtRandom, GivesTheSameSamplesWhateverTheOrderOfTwoCyclesFrames) {
  const std::uint64_t seed = test_seed(99);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  for (int repetition = 0; repetition < 200; ++repetition) {
    const auto first = static_cast<std::uint32_t>(engine() % 100'000);
    Listener in_order;
    std::vector<TimedFrame> run = healthy_run(in_order, first, 60);
    for (const TimedFrame& timed : run) in_order.push(timed.frame);
    in_order.finish();
    // A delay below two cycles lets the frames of k and k+1 mix, and none of k+2 precede one of k.
    std::uniform_real_distribution<double> delay(0.0, 1.999);
    for (TimedFrame& timed : run) {
      const bool is_first_sync = timed.time == 0.0;
      timed.time = is_first_sync ? -1.0 : timed.cycle - first + delay(engine);
    }
    std::stable_sort(run.begin(), run.end(),
                     [](const TimedFrame& a, const TimedFrame& b) { return a.time < b.time; });
    Listener mixed;
    for (const TimedFrame& timed : run) mixed.push(timed.frame);
    mixed.finish();
    ASSERT_EQ(mixed.seen.size(), 60u) << "repetition " << repetition;
    ASSERT_EQ(mixed.seen, in_order.seen) << "repetition " << repetition;
    ASSERT_EQ(mixed.sampler.counters().bad_samples, 0u);
  }
}

TEST(SamplerAtRandom, GivesExactlyOneSamplePerCycleWhateverIsLost) {
  const std::uint64_t seed = test_seed(5);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  constexpr std::uint32_t kCycles = 300;
  for (int repetition = 0; repetition < 100; ++repetition) {
    const double loss = std::uniform_real_distribution<double>(0.0, 0.4)(engine);
    std::bernoulli_distribution is_lost(loss);
    Listener listener;
    std::array<bool, kCycles> sensors_whole;
    std::array<bool, kCycles> commands_whole;
    sensors_whole.fill(true);
    commands_whole.fill(true);
    for (const TimedFrame& timed : healthy_run(listener, 0, kCycles)) {
      const bool may_be_lost = timed.cycle > 0 && timed.cycle < kCycles - 1;
      if (may_be_lost && is_lost(engine)) {
        (timed.is_command ? commands_whole : sensors_whole)[timed.cycle] = false;
      } else {
        listener.push(timed.frame);
      }
    }
    listener.finish();
    ASSERT_EQ(listener.seen.size(), kCycles) << "repetition " << repetition;
    for (std::uint32_t k = 0; k < kCycles; ++k) {
      const Seen& sample = listener.seen[k];
      ASSERT_EQ(sample.cycle, k);
      const bool is_whole = sensors_whole[k] && (k == 0 || commands_whole[k - 1]);
      ASSERT_EQ((sample.flags & kBadSample) == 0, is_whole) << "cycle " << k;
      if (is_whole && k > 0) expect_whole(sample, k, k - 1);
    }
  }
}

TEST(SamplerAtRandom, SurvivesAnyFrames) {
  const std::uint64_t seed = test_seed(17);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 engine(seed);
  for (const SignalMap& map :
       {full_map(), map_with({}), map_with({kSyncRole}), map_with({kSensorCycleRoles})}) {
    Listener listener(map);
    for (int n = 0; n < 20'000; ++n) {
      CanFrame frame;
      frame.id = static_cast<std::uint32_t>(engine() % 7);
      frame.length = static_cast<std::uint8_t>(engine() % 3 == 0 ? engine() % 9 : 8);
      for (std::uint8_t byte = 0; byte < frame.length; ++byte) {
        frame.data[byte] = static_cast<std::uint8_t>(engine() % 4 == 0 ? engine() : 0);
      }
      listener.push(frame);
    }
    listener.finish();
    const SamplerCounters& counters = listener.sampler.counters();
    EXPECT_EQ(counters.samples, listener.seen.size());
    const auto bad = std::count_if(listener.seen.begin(), listener.seen.end(),
                                   [](const Seen& seen) { return (seen.flags & kBadSample) != 0; });
    EXPECT_EQ(counters.bad_samples, static_cast<std::uint64_t>(bad));
  }
}

TEST(Sampler, DoesNotAllocate) {
  Listener listener;
  const std::vector<TimedFrame> run = healthy_run(listener, 0, 1200);
  std::uint64_t samples = 0;
  double sum = 0.0;
  const AllocationGuard guard;
  for (const TimedFrame& timed : run) {
    if (timed.cycle % 50 == 3) continue;  // gaps and missing commands as well
    listener.sampler.push(timed.frame);
    while (const Sample* sample = listener.sampler.take()) {
      ++samples;
      sum += sample->y[0];
    }
  }
  listener.sampler.finish();
  while (listener.sampler.take() != nullptr) ++samples;
  listener.sampler.reset();
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(samples, 1200u);
  EXPECT_GT(sum, 0.0);
}

TEST(SamplerInBusOrder, DoesNotAllocate) {
  Listener listener(map_with({}));
  std::vector<CanFrame> run;
  for (std::uint32_t k = 0; k < 1000; ++k) {
    run.push_back(listener.sensor_frame(0, k));
    run.push_back(listener.sensor_frame(1, k));
    run.push_back(listener.command_frame(0, k));
    run.push_back(listener.command_frame(1, k));
  }
  std::uint64_t samples = 0;
  const AllocationGuard guard;
  for (const CanFrame& frame : run) {
    listener.sampler.push(frame);
    while (listener.sampler.take() != nullptr) ++samples;
  }
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(samples, 1000u);
}

}  // namespace
}  // namespace faultline

// Sensor messages that are slower than the cycle: held with their age.
#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "drivers/dbc/dbc_parser.h"
#include "drivers/signal/sampler.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

constexpr std::string_view kDbc =
    "BO_ 1 Sync: 8 P\n"
    " SG_ k : 0|32@1+ (1,0) [0|0] \"\" C\n"
    " SG_ c : 32|32@1+ (1,0) [0|0] \"\" C\n"
    "BO_ 2 Fast: 8 P\n"
    " SG_ y1 : 0|16@1- (1,0) [0|0] \"\" C\n"
    " SG_ k_a : 32|4@1+ (1,0) [0|0] \"\" C\n"
    "BO_ 3 Slow: 8 P\n"
    " SG_ y2 : 0|16@1- (1,0) [0|0] \"\" C\n"
    " SG_ k_b : 32|4@1+ (1,0) [0|0] \"\" C\n"
    "BA_DEF_ SG_ \"FaultlineRole\" STRING ;\n"
    "BA_DEF_DEF_ \"FaultlineRole\" \"\";\n"
    "BA_ \"FaultlineRole\" SG_ 1 k \"sync\";\n"
    "BA_ \"FaultlineRole\" SG_ 1 c \"command_cycle\";\n"
    "BA_ \"FaultlineRole\" SG_ 2 k_a \"cycle\";\n"
    "BA_ \"FaultlineRole\" SG_ 3 k_b \"cycle\";\n";
constexpr std::uint32_t kPeriod = 4;

SignalMap slow_map() {
  SignalMap map = make_signal_map(parse_dbc(kDbc, "unit.dbc"), {"y1", "y2"}, {});
  map.sensor_messages[1].cycles_per_frame = kPeriod;
  return map;
}

struct Taken {
  std::uint32_t cycle, flags, age;
  double y1, y2;
  bool is_fresh;
  Blame blame;
};

/// A unit whose Slow comes where it is told to, and the sampler that listens.
class SlowUnit {
 public:
  void cycle(std::uint32_t k, bool has_slow) {
    CanFrame frame;
    map_.sync->encode(k, kNoCommand, frame);
    push(frame);
    const double y[] = {static_cast<double>(k), static_cast<double>(k)};
    map_.sensor_messages[0].encode(y, k, frame);
    push(frame);
    if (!has_slow) return;
    map_.sensor_messages[1].encode(y, k, frame);
    push(frame);
  }
  void push(const CanFrame& frame) {
    sampler.push(frame);
    while (const Sample* sample = sampler.take()) {
      taken.push_back({sample->cycle, sample->flags, sample->y_age[1], sample->y[0], sample->y[1],
                       sample->y_is_fresh[1] != 0, sample->blame});
    }
  }

 private:
  const SignalMap map_ = slow_map();

 public:
  Sampler sampler{map_};
  std::vector<Taken> taken;
};

TEST(SlowMessage, IsHeldWithItsAgeInGoodSamplesThatDoNotWait) {
  SlowUnit unit;
  for (std::uint32_t k = 0; k < 40; ++k) {
    unit.cycle(k, k % kPeriod == 0);
    ASSERT_EQ(unit.taken.size(), k + 1U) << "closed with the last frame of its cycle";
    const Taken& sample = unit.taken.back();
    EXPECT_EQ(sample.cycle, k);
    EXPECT_EQ(sample.flags, 0U) << k;
    EXPECT_EQ(sample.y1, k);
    EXPECT_EQ(sample.y2, k - k % kPeriod);
    EXPECT_EQ(sample.age, k % kPeriod);
    EXPECT_EQ(sample.is_fresh, k % kPeriod == 0);
  }
  EXPECT_EQ(unit.sampler.counters().bad_samples, 0U);
  EXPECT_EQ(unit.sampler.counters().missing_messages, 0U);
}

TEST(SlowMessage, MayComeInAnyCycles) {
  SlowUnit unit;
  for (std::uint32_t k = 3; k < 43; ++k) unit.cycle(k, k % kPeriod == 3);
  ASSERT_EQ(unit.taken.size(), 40U);
  for (const Taken& sample : unit.taken) EXPECT_EQ(sample.flags, 0U) << sample.cycle;
}

TEST(SlowMessage, IsMissedFromThenOnWhenItIsDue) {
  SlowUnit unit;
  for (std::uint32_t k = 0; k < 20; ++k) unit.cycle(k, k % kPeriod == 0 && k != 8);
  unit.sampler.finish();
  ASSERT_EQ(unit.taken.size(), 20U);
  for (const Taken& sample : unit.taken) {
    // Its value is older than it ever should be from 8 on, until it comes in 12.
    const bool is_missed = sample.cycle >= 8 && sample.cycle < 12;
    EXPECT_EQ(sample.flags, is_missed ? kSampleSensorMissing : 0U) << sample.cycle;
    EXPECT_EQ(sample.blame, (is_missed ? Blame{1, MessageFault::kMissing} : Blame{}));
  }
  EXPECT_EQ(unit.taken[11].age, 7U);
  EXPECT_EQ(unit.taken[11].y2, 4.0);
  EXPECT_EQ(unit.sampler.counters().missing_messages, 4U);
  EXPECT_EQ(unit.sampler.message_counters(1).missing, 4U);
}

TEST(SlowMessage, IsUnknownUntilItHasCome) {
  SlowUnit unit;
  for (std::uint32_t k = 5; k < 16; ++k) unit.cycle(k, k % kPeriod == 0);
  ASSERT_FALSE(unit.taken.empty());
  for (const Taken& sample : unit.taken) {
    EXPECT_EQ(sample.flags, sample.cycle < 8 ? kSampleSensorMissing : 0U) << sample.cycle;
  }
  EXPECT_EQ(unit.taken.back().cycle, 15U);
}

TEST(SlowMessage, IsForgottenWhenTheUnitStartsAgain) {
  SlowUnit unit;
  for (std::uint32_t k = 0; k < 22; ++k) unit.cycle(k, k % kPeriod == 0);
  unit.taken.clear();
  for (std::uint32_t k = 0; k < 8; ++k) unit.cycle(k, k % kPeriod == 0);
  ASSERT_EQ(unit.taken.size(), 8U);
  EXPECT_EQ(unit.taken[0].flags, kSampleReset);
  for (std::size_t k = 1; k < 8; ++k) EXPECT_EQ(unit.taken[k].flags, 0U) << k;
}

TEST(SlowMessage, NeverAllocates) {
  SlowUnit unit;
  unit.taken.reserve(2000);
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) unit.cycle(k, k % kPeriod == 0);
  EXPECT_EQ(guard.heap_calls(), 0U);
  EXPECT_EQ(unit.taken.size(), 1000U);
}

}  // namespace
}  // namespace faultline

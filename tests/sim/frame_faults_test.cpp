#include "sim/frame_faults.h"

#include <algorithm>
#include <array>
#include <bitset>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/frame_damage.h"
#include "tests/sim/test_plants.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::SizeIs;
using enum InjectionKind;

constexpr double kT = 0.1;
constexpr std::size_t kPosition = 0, kSpeed = 1;

FaultTargets targets_of(const PlantModel& plant, const SignalMap& map) {
  FaultTargets targets = fault_targets(plant);
  const auto add = [&](const auto& message, bool is_command) {
    targets.messages.push_back({message.name, is_command, message.protection.has_crc(),
                                message.protection.has_counter(), message.length});
  };
  for (const MappedMessage& message : map.sensor_messages) add(message, false);
  for (const MappedMessage& message : map.command_messages) add(message, true);
  add(*map.sync, false);
  return targets;
}

Injection fault(const std::string& target, InjectionKind kind, std::uint32_t from,
                std::optional<std::uint32_t> until = std::nullopt,
                std::optional<double> value = std::nullopt) {
  Injection injection;
  injection.target = target;
  injection.kind = kind;
  injection.value = value;
  injection.at_s = from * kT;
  if (until) injection.until_s = *until * kT;
  return injection;
}

/// A node that sends SYNC, Position (y1 = k + 0.5) and Speed (y2 = -k), or Command (force = 2 k),
/// in every cycle, and what comes out behind its faults.
class Line {
 public:
  explicit Line(std::vector<Injection> injections, BenchNode node = BenchNode::kPlant,
                SignalMap signal_map = protected_double_integrator_map(), std::int64_t seed = 1)
      : map(std::move(signal_map)),
        schedule(targets_of(double_integrator(), map), std::move(injections), seed),
        faults(map, schedule, node, kT),
        node_(node),
        sensors_(protectors(map.sensor_messages)),
        commands_(protectors(map.command_messages)),
        sync_(map.sync->protection) {
    faults.set_output(sink_);
    sink_.frames.reserve(1000);
  }

  /// The frames of a cycle as they came out.
  std::vector<CanFrame> cycle(std::uint32_t k) {
    send(k);
    return std::exchange(sink_.frames, {});
  }
  void send(std::uint32_t k) noexcept {
    sink_.frames.clear();
    const std::array<double, 2> y{k + 0.5, -1.0 * k};
    const std::array<double, 1> u{2.0 * k};
    faults.begin_cycle(k);
    CanFrame frame;
    if (node_ == BenchNode::kController) {
      map.command_messages[0].encode(u, k, frame);
      commands_[0].protect(frame);
      faults.send(frame);
      return;
    }
    map.sync->encode(k, k, frame);
    sync_.protect(frame);
    faults.send(frame);
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      map.sensor_messages[i].encode(y, k, frame);
      sensors_[i].protect(frame);
      faults.send(frame);
    }
  }
  /// "Sync0 Position0 Speed0": message and low bits of its cycle; "?" where it is none of the map.
  std::string names(std::uint32_t k) {
    std::string text;
    for (const CanFrame& frame : cycle(k)) {
      if (!text.empty()) text += ' ';
      text += name_of(frame);
    }
    return text;
  }
  std::string name_of(const CanFrame& frame) const {
    std::int64_t number = -1;
    if (map.sync->matches(frame)) {
      static_cast<void>(map.sync->cycle.decode_raw(frame.payload(), number));
      return "Sync" + std::to_string(number);
    }
    for (const auto* side : {&map.sensor_messages, &map.command_messages}) {
      for (const MappedMessage& message : *side) {
        if (!message.matches(frame)) continue;
        static_cast<void>(message.cycle->decode_raw(frame.payload(), number));
        return message.name + std::to_string(number);
      }
    }
    return "?";
  }
  std::array<double, 2> outputs(const std::vector<CanFrame>& frames) const {
    std::array<double, 2> y{};
    for (const CanFrame& frame : frames) {
      for (const MappedMessage& message : map.sensor_messages) {
        if (message.matches(frame)) static_cast<void>(message.decode(frame, y));
      }
    }
    return y;
  }

  const SignalMap map;
  FaultSchedule schedule;
  FrameFaults faults;

 private:
  BenchNode node_;
  RecordingSink sink_;
  std::vector<MessageProtector> sensors_, commands_;
  MessageProtector sync_;
};

/// What a receiver makes of each frame of a message over cycles 0 .. count - 1.
std::vector<IntegrityStatus> statuses(Line& line, std::size_t message, std::uint32_t count) {
  const MappedMessage& mapped = line.map.sensor_messages[message];
  MessageIntegrity integrity(mapped.protection);
  std::vector<IntegrityStatus> found;
  for (std::uint32_t k = 0; k < count; ++k) {
    for (const CanFrame& frame : line.cycle(k)) {
      if (mapped.matches(frame)) found.push_back(integrity.check(frame).status);
    }
  }
  return found;
}

TEST(FrameFaults, PassesEverythingOnUnchangedWhereNothingActs) {
  Line clean({});
  Line faulty({fault("Position", kDropped, 2, 3), fault("y1", kOffset, 2, 3, 1.0)});
  for (std::uint32_t k = 0; k < 2; ++k) {
    const std::vector<CanFrame> expected = clean.cycle(k);
    const std::vector<CanFrame> found = faulty.cycle(k);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_TRUE(same_on_wire(found[i], expected[i]));
    }
  }
  EXPECT_TRUE(faulty.faults.counters().is_clean());
  EXPECT_FALSE(clean.faults.may_withhold());
  EXPECT_TRUE(faulty.faults.may_withhold());
}

TEST(FrameFaults, DropsAMessageWhileTheFaultActs) {
  Line line({fault("Position", kDropped, 1, 3)});
  EXPECT_EQ(line.names(0), "Sync0 Position0 Speed0");
  EXPECT_EQ(line.names(1), "Sync1 Speed1");
  EXPECT_EQ(line.names(2), "Sync2 Speed2");
  EXPECT_EQ(line.names(3), "Sync3 Position3 Speed3");
  EXPECT_EQ(line.faults.counters().dropped, 2U);
}

TEST(FrameFaults, SendsADelayedMessageInTheCycleItIsDueBeforeItsSuccessor) {
  Line line({fault("Position", kDelayed, 1, 2, 2.0)});
  EXPECT_EQ(line.names(0), "Sync0 Position0 Speed0");
  EXPECT_EQ(line.names(1), "Sync1 Speed1");
  EXPECT_EQ(line.faults.counters().dropped, 1U);  // so far
  EXPECT_EQ(line.names(2), "Sync2 Position2 Speed2");
  EXPECT_EQ(line.names(3), "Sync3 Position1 Position3 Speed3");
  EXPECT_EQ(line.faults.counters().dropped, 0U);
  EXPECT_EQ(line.faults.counters().late, 1U);
}

TEST(FrameFaults, SendsADelayedMessageAtTheEndOfItsCycleWhereItHasNoSuccessor) {
  Line line({fault("Position", kDelayed, 0, 1), fault("Position", kDropped, 1, 2)});
  EXPECT_EQ(line.names(0), "Sync0 Speed0");
  EXPECT_EQ(line.names(1), "Sync1 Position0 Speed1");  // its place, taken by nobody
  Line silent({fault("Command", kDelayed, 0, 1)}, BenchNode::kController);
  EXPECT_EQ(silent.names(0), "");
  // Nothing is given in cycle 1: what was due goes out as cycle 2 begins.
  silent.faults.begin_cycle(1);
  EXPECT_EQ(silent.names(2), "Command0 Command2");
}

TEST(FrameFaults, AddsUpDelaysAndKeepsTheOrderWithinAMessage) {
  Line line({fault("Speed", kDelayed, 0), fault("Speed", kDelayed, 0)});
  EXPECT_EQ(line.names(0), "Sync0 Position0");
  EXPECT_EQ(line.names(1), "Sync1 Position1");
  EXPECT_EQ(line.names(2), "Sync2 Position2 Speed0");
  EXPECT_EQ(line.names(3), "Sync3 Position3 Speed1");
}

TEST(FrameFaults, SendsDuplicatesAtOnce) {
  Line line({fault("Position", kDuplicated, 1, 2, 2.0)});
  EXPECT_EQ(line.names(0), "Sync0 Position0 Speed0");
  EXPECT_EQ(line.names(1), "Sync1 Position1 Position1 Position1 Speed1");
  EXPECT_EQ(line.faults.counters().added, 2U);
}

TEST(FrameFaults, SendsAReorderedMessageBehindTheNextFrameOfItsNode) {
  Line line({fault("Position", kReordered, 1, 2), fault("Speed", kReordered, 3, 4)});
  EXPECT_EQ(line.names(0), "Sync0 Position0 Speed0");
  EXPECT_EQ(line.names(1), "Sync1 Speed1 Position1");
  EXPECT_EQ(line.names(2), "Sync2 Position2 Speed2");
  EXPECT_EQ(line.names(3), "Sync3 Position3");
  EXPECT_EQ(line.names(4), "Sync4 Speed3 Position4 Speed4");
}

TEST(FrameFaults, FreezesTheCounterAtThatOfTheFrameBefore) {
  using enum IntegrityStatus;
  Line line({fault("Speed", kFrozenCounter, 2, 5)});
  EXPECT_THAT(statuses(line, kSpeed, 7), ElementsAre(kOk, kOk, kCounterRepeated, kCounterRepeated,
                                                     kCounterRepeated, kCounterGap, kOk));
  EXPECT_EQ(line.faults.counters().changed, 3U);
}

TEST(FrameFaults, InvertsChecksums) {
  using enum IntegrityStatus;
  constexpr InjectionKind kInverted = InjectionKind::kWrongCrc;
  Line line({fault("Position", kInverted, 2, 4), fault("Speed", kInverted, 2, 4)});
  EXPECT_THAT(statuses(line, kPosition, 5), ElementsAre(kOk, kOk, kWrongCrc, kWrongCrc, kOk));
}

TEST(FrameFaults, InvertsBothBytesOfAChecksumOfSixteenBits) {
  Line clean({});
  Line line({fault("Position", kWrongCrc, 0)});
  const CanFrame expected = clean.cycle(0)[1];
  const CanFrame found = line.cycle(0)[1];
  for (std::size_t byte = 0; byte < expected.length; ++byte) {
    const bool is_crc = byte == 5 || byte == 6;
    EXPECT_EQ(found.data[byte] ^ expected.data[byte], is_crc ? 0xFF : 0) << byte;
  }
}

TEST(FrameFaults, FlipsAsManyBitsAsAsked) {
  for (const double bits : {1.0, 3.0, 13.0, 56.0}) {
    Line clean({});
    Line line({fault("Speed", kCorrupted, 0, std::nullopt, bits)});
    std::size_t changed_alike = 0;
    std::uint64_t last = 0;
    for (std::uint32_t k = 0; k < 100; ++k) {
      const CanFrame expected = clean.cycle(k)[2];
      const CanFrame found = line.cycle(k)[2];
      std::uint64_t flipped = 0;
      for (std::size_t byte = 0; byte < 7; ++byte) {
        flipped |= std::uint64_t{static_cast<std::uint8_t>(found.data[byte] ^ expected.data[byte])}
                   << (8 * byte);
      }
      EXPECT_EQ(std::bitset<64>(flipped).count(), static_cast<std::size_t>(bits));
      changed_alike += flipped == last ? 1U : 0U;
      last = flipped;
    }
    // All 56 are the same each time.
    EXPECT_EQ(changed_alike > 50, bits == 56.0) << bits << " " << changed_alike;
  }
}

TEST(FrameFaults, FlipsEveryBitEquallyOften) {
  std::array<int, 56> counts{};
  constexpr int kRounds = 5600;
  Line line({fault("Speed", kCorrupted, 0, std::nullopt, 2.0)});
  Line clean({});
  for (std::uint32_t k = 0; k < kRounds; ++k) {
    const CanFrame expected = clean.cycle(k)[2];
    const CanFrame found = line.cycle(k)[2];
    for (std::size_t bit = 0; bit < 56; ++bit) {
      counts[bit] += (found.data[bit / 8] ^ expected.data[bit / 8]) >> (bit % 8) & 1;
    }
  }
  // 200 each on average, standard deviation 13.9: five of them.
  for (const int count : counts) EXPECT_NEAR(count, 200, 70);
}

TEST(FrameFaults, ChangesTheLengthToOneThatTheFrameCanHave) {
  Line line({fault("Speed", kWrongDlc, 0), fault("Position", kWrongDlc, 0, std::nullopt, 3.0),
             fault("Sync", kWrongDlc, 0)});
  const std::vector<CanFrame> frames = line.cycle(0);
  EXPECT_EQ(frames[0].length, 8);  // one byte less than 12: FD has nothing between 8 and 12
  EXPECT_EQ(frames[1].length, 3);
  EXPECT_EQ(frames[2].length, 6);
  for (const CanFrame& frame : frames) {
    EXPECT_TRUE(is_well_formed(frame));
    for (std::size_t byte = frame.length; byte < kMaxPayload; ++byte) {
      EXPECT_EQ(frame.data[byte], 0);
    }
  }
}

TEST(FrameFaults, BabblesWithDrawnPayloads) {
  Line line({fault("Position", kBabbling, 1, 2, 3.0)});
  EXPECT_EQ(line.names(0), "Sync0 Position0 Speed0");
  const std::vector<CanFrame> frames = line.cycle(1);
  ASSERT_THAT(frames, SizeIs(6));
  for (std::size_t n = 0; n < 3; ++n) {
    EXPECT_TRUE(line.map.sensor_messages[kPosition].matches(frames[n]));
    EXPECT_EQ(frames[n].length, 8);
    EXPECT_FALSE(same_on_wire(frames[n], frames[n + 1]));
  }
  EXPECT_EQ(line.faults.unheard(), 0U);
  EXPECT_EQ(line.faults.counters().added, 3U);
}

TEST(FrameFaults, BabblesByTheNodeThatSendsTheIdentifierElseByThePlant) {
  const auto count = [](const std::string& id, BenchNode node) {
    Line line({fault(id, kBabbling, 0)}, node);
    const std::size_t own = node == BenchNode::kPlant ? 3 : 1;
    const std::size_t more = line.cycle(0).size() - own;
    return std::pair(more, line.faults.unheard());
  };
  using Found = std::pair<std::size_t, std::uint64_t>;
  EXPECT_EQ(count("2", BenchNode::kPlant), Found(1, 0));
  EXPECT_EQ(count("2", BenchNode::kController), Found(0, 0));
  EXPECT_EQ(count("0x4", BenchNode::kPlant), Found(0, 0));
  EXPECT_EQ(count("0x4", BenchNode::kController), Found(1, 0));
  EXPECT_EQ(count("0x123", BenchNode::kPlant), Found(1, 1));
  EXPECT_EQ(count("0x123", BenchNode::kController), Found(0, 0));
  Line extended({fault("0x12345", kBabbling, 0)});
  EXPECT_TRUE(extended.cycle(0)[0].is_extended);
}

TEST(FrameFaults, ABusOffNodeNeitherSendsNorHears) {
  Line line({fault("plant", kBusOff, 2, 4), fault("Position", kDelayed, 1, 2),
             fault("0x123", kBabbling, 3, 5)});
  EXPECT_EQ(line.names(0), "Sync0 Position0 Speed0");
  EXPECT_TRUE(line.faults.hears());
  EXPECT_EQ(line.names(1), "Sync1 Speed1");
  EXPECT_EQ(line.names(2), "");  // and what was delayed to now is lost
  EXPECT_FALSE(line.faults.hears());
  EXPECT_EQ(line.names(3), "");
  EXPECT_EQ(line.names(4), "? Sync4 Position4 Speed4");
  EXPECT_TRUE(line.faults.hears());
  EXPECT_EQ(line.faults.counters().dropped, 7U);

  Line controller({fault("plant", kBusOff, 0)}, BenchNode::kController);
  EXPECT_EQ(controller.names(0), "Command0");
  EXPECT_TRUE(controller.faults.hears());
}

TEST(FrameFaults, FreezesASignalAndKeepsItsMessageWhole) {
  Line line({fault("y1", kFrozen, 2, 4)});
  MessageIntegrity integrity(line.map.sensor_messages[kPosition].protection);
  const std::array<double, 6> expected{0.5, 1.5, 2.5, 2.5, 4.5, 5.5};
  for (std::uint32_t k = 0; k < expected.size(); ++k) {
    const std::vector<CanFrame> frames = line.cycle(k);
    EXPECT_EQ(line.outputs(frames)[0], expected[k]);
    EXPECT_EQ(line.outputs(frames)[1], -1.0 * k);
    EXPECT_EQ(line.name_of(frames[1]), "Position" + std::to_string(k));
    EXPECT_EQ(integrity.check(frames[1]).status, IntegrityStatus::kOk);
  }
}

TEST(FrameFaults, FreezesAnewEachTimeItActs) {
  Injection injection = fault("y1", kFrozen, 0);
  injection.period_s = 4 * kT;
  Line line({injection});
  std::vector<double> found;
  for (std::uint32_t k = 0; k < 8; ++k) found.push_back(line.outputs(line.cycle(k))[0]);
  EXPECT_THAT(found, ElementsAre(0.5, 0.5, 2.5, 3.5, 4.5, 4.5, 6.5, 7.5));
}

TEST(FrameFaults, OffsetsASignalAlongItsRamp) {
  Injection injection = fault("force", kOffset, 2, 10, 4.0);
  injection.ramp_s = 4 * kT;
  Line line({injection}, BenchNode::kController);
  const MappedMessage& command = line.map.command_messages[0];
  MessageIntegrity integrity(command.protection);
  std::vector<double> found;
  for (std::uint32_t k = 0; k < 12; ++k) {
    const std::vector<CanFrame> frames = line.cycle(k);
    std::array<double, 1> u{};
    EXPECT_EQ(command.decode(frames[0], u), CodecStatus::kOk);
    EXPECT_EQ(integrity.check(frames[0]).status, IntegrityStatus::kOk);
    found.push_back(u[0] - 2.0 * k);
  }
  EXPECT_THAT(found, testing::Pointwise(testing::DoubleNear(1e-3),
                                        {0., 0., 0., 1., 2., 3., 4., 4., 4., 4., 0., 0.}));
}

TEST(FrameFaults, SwapsSignalsOfTwoMessagesWithinTheCycle) {
  Injection injection = fault("y2", kSwapped, 1, 3);
  injection.with = "y1";
  Line line({injection});
  MessageIntegrity position(line.map.sensor_messages[kPosition].protection);
  MessageIntegrity speed(line.map.sensor_messages[kSpeed].protection);
  for (std::uint32_t k = 0; k < 4; ++k) {
    const std::vector<CanFrame> frames = line.cycle(k);
    ASSERT_THAT(frames, SizeIs(3));
    const bool is_swapped = k == 1 || k == 2;
    const double y1 = k + 0.5;
    const double y2 = -1.0 * k;
    EXPECT_EQ(line.outputs(frames)[0], is_swapped ? y2 : y1);
    EXPECT_EQ(line.outputs(frames)[1], is_swapped ? y1 : y2);
    const std::string number = std::to_string(k);
    EXPECT_EQ(line.name_of(frames[0]), "Sync" + number);
    EXPECT_EQ(line.name_of(frames[1]), "Position" + number);
    EXPECT_EQ(line.name_of(frames[2]), "Speed" + number);
    EXPECT_EQ(position.check(frames[1]).status, IntegrityStatus::kOk);
    EXPECT_EQ(speed.check(frames[2]).status, IntegrityStatus::kOk);
  }
  EXPECT_EQ(line.faults.counters().changed, 4U);
}

TEST(FrameFaults, ChangesSignalsWithoutProtectionToo) {
  Line line({fault("y1", kOffset, 0, std::nullopt, 3.0)}, BenchNode::kPlant,
            double_integrator_map());
  EXPECT_EQ(line.outputs(line.cycle(5))[0], 8.5);
}

TEST(FrameFaults, ActsOnSignalsThenOnBytesThenOnTheWay) {
  // The checksum is made right for the offset, then spoilt; and two wrong frames come, a cycle
  // late.
  Line line({fault("Speed", kDuplicated, 1, 2), fault("Speed", kDelayed, 1, 2),
             fault("Speed", kWrongCrc, 1, 2), fault("y2", kOffset, 1, 2, 0.5)});
  EXPECT_EQ(line.names(0), "Sync0 Position0 Speed0");
  EXPECT_EQ(line.names(1), "Sync1 Position1");
  const std::vector<CanFrame> frames = line.cycle(2);
  ASSERT_THAT(frames, SizeIs(5));
  CanFrame late = frames[2];
  EXPECT_TRUE(same_on_wire(frames[2], frames[3]));
  EXPECT_EQ(line.name_of(late), "Speed1");
  EXPECT_EQ(line.outputs({late})[1], -0.5);
  const MessageProtection& protection = line.map.message_protection(kSpeed);
  EXPECT_FALSE(protection.is_crc_right(late.payload()));
  invert_checksum(protection, late);
  EXPECT_TRUE(protection.is_crc_right(late.payload()));
}

TEST(FrameFaults, FollowsWhatIsAddedWhileItRuns) {
  Line line({});
  EXPECT_EQ(line.names(0), "Sync0 Position0 Speed0");
  line.schedule.add(fault("Speed", kDropped, 2));
  EXPECT_EQ(line.names(1), "Sync1 Position1 Speed1");
  EXPECT_EQ(line.names(2), "Sync2 Position2");
  line.schedule.clear("Speed", 3 * kT);
  EXPECT_EQ(line.names(3), "Sync3 Position3 Speed3");
}

TEST(FrameFaults, DropsInTheShareOfCyclesThatWasAskedForAndAlikeForASeed) {
  Injection injection = fault("Speed", kDropped, 0);
  injection.probability = 0.3;
  const auto pattern = [&](std::int64_t seed) {
    Line line({injection}, BenchNode::kPlant, protected_double_integrator_map(), seed);
    std::vector<bool> dropped;
    for (std::uint32_t k = 0; k < 1000; ++k) dropped.push_back(line.cycle(k).size() == 2);
    return dropped;
  };
  const std::vector<bool> first = pattern(1);
  EXPECT_EQ(first, pattern(1));
  EXPECT_NE(first, pattern(2));
  // 300 on average, standard deviation 14.5.
  EXPECT_NEAR(static_cast<double>(std::count(first.begin(), first.end(), true)), 300.0, 75.0);
}

TEST(FrameFaults, DoesNotAllocateWhateverActs) {
  std::vector<Injection> injections;
  for (const InjectionKind kind : {kDropped, kDelayed, kDuplicated, kReordered, kCorrupted,
                                   kWrongCrc, kFrozenCounter, kWrongDlc, kBabbling}) {
    for (const char* message : {"Position", "Speed", "Sync"}) {
      injections.push_back(fault(message, kind, 10));
      injections.back().probability = 0.3;
      if (kind == kDelayed) injections.back().value = 100;
    }
  }
  injections.push_back(fault("y1", kFrozen, 10));
  injections.back().probability = 0.5;
  injections.push_back(fault("y2", kOffset, 10, std::nullopt, 1.0));
  injections.push_back(fault("y1", kSwapped, 10));
  injections.back().with = "y2";
  injections.back().probability = 0.5;
  injections.push_back(fault("plant", kBusOff, 500, 520));
  Line line(injections);
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) line.send(k);
  const std::uint64_t calls = guard.heap_calls();
  EXPECT_EQ(calls, 0U);
  EXPECT_GT(line.faults.counters().dropped, 100U);
  EXPECT_GT(line.faults.counters().changed, 100U);
  EXPECT_GT(line.faults.counters().late, 100U);
  EXPECT_GT(line.faults.counters().added, 100U);
}

TEST(FrameFaults, AccountsForEveryFrame) {
  Injection lossy = fault("Position", kDropped, 0);
  lossy.probability = 0.2;
  Injection slow = fault("Speed", kDelayed, 0, std::nullopt, 7.0);
  slow.probability = 0.5;
  Line line({lossy, slow, fault("Sync", kDuplicated, 50, 60), fault("plant", kBusOff, 80, 90)});
  std::size_t came_out = 0;
  for (std::uint32_t k = 0; k < 200; ++k) came_out += line.cycle(k).size();
  const FrameFaultCounters counters = line.faults.counters();
  EXPECT_EQ(came_out + counters.dropped, 600U + counters.added);
}

}  // namespace
}  // namespace faultline

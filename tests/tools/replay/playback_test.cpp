#include "tools/replay/playback.h"

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <unistd.h>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tools/lcm/channels.h"
#include "tools/lcm/frame_message.h"
#include "tools/lcm/message_sink.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

/// Remembers what it is sent, and refuses the frames or messages it is told to.
class MemoryTarget final : public PlaybackTarget {
 public:
  std::size_t send(const PlaybackChunk& chunk, const PlaybackItem& item) noexcept override {
    if (is_of_messages) {
      const auto* const name = reinterpret_cast<const char*>(chunk.bytes.data() + item.channel);
      sent.push_back(fmt::format("{} {}", name, item.count));
      messages.emplace_back(chunk.bytes.begin() + item.begin,
                            chunk.bytes.begin() + item.begin + item.count);
      return 1;
    }
    std::size_t taken = 0;
    for (std::uint32_t i = 0; i < item.count; ++i) {
      const CanFrame& frame = chunk.frames[item.begin + i];
      if (frame.id == refused_id) continue;
      sent.push_back(fmt::format("{:X}@{}", frame.id, frame.bus));
      ids.push_back(frame.id);
      ++taken;
    }
    group_sizes.push_back(item.count);
    return taken;
  }
  [[nodiscard]] std::string refusal() const override { return ""; }

  bool is_of_messages = false;
  std::uint32_t refused_id = 0xFFFF'FFFF;
  std::vector<std::string> sent;
  std::vector<std::uint32_t> ids, group_sizes;
  std::vector<std::vector<std::uint8_t>> messages;
};

class PlaybackTest : public testing::Test {
 protected:
  PlaybackTest()
      : folder_(std::filesystem::path(testing::TempDir()) /
                fmt::format("faultline-playback-{}", ::getpid())) {
    std::filesystem::create_directory(folder_);
  }
  ~PlaybackTest() override { std::filesystem::remove_all(folder_); }

  std::string write_candump(const std::string& text) {
    const std::string file = (folder_ / "frames.log").string();
    std::ofstream(file) << text;
    return file;
  }

  static PlaybackLog open(PlaybackSelection selection) {
    if (selection.buses.empty()) selection.buses = {"vcan0"};
    return {std::move(selection), [](const std::string&) {}};
  }

  static std::string refusal_of(PlaybackSelection selection) {
    try {
      static_cast<void>(open(std::move(selection)));
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  }

  static PlaybackResult play_at_once(const PlaybackLog& log, PlaybackTarget& target,
                                     std::uint64_t passes = 1) {
    return play(log, target, {.speed = 0.0, .passes = passes}, [](const PlaybackProgress&) {});
  }

  /// Times at which the units of a log are sent, ns since its begin.
  static std::vector<std::int64_t> times_of(const PlaybackLog& log) {
    std::vector<std::int64_t> times;
    const auto take = [&times](std::int64_t at_ns) {
      times.push_back(at_ns);
      return true;
    };
    log.read({.on_frame = [&](std::int64_t at_ns, const CanFrame&) { return take(at_ns); },
              .on_message = [&](std::int64_t at_ns, std::string_view,
                                std::span<const std::uint8_t>) { return take(at_ns); }});
    return times;
  }

  std::filesystem::path folder_;
};

TEST_F(PlaybackTest, SendsEveryFrameOfALongLogInOrderPassAfterPass) {
  // More than all chunks of the queue hold together.
  constexpr std::uint32_t kFrames = 20'000;
  std::string text;
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    text += fmt::format("({}.{:06}) vcan0 {:08X}#\n", 100 + i / 1000, i % 1000 * 1000, i);
  }
  const PlaybackLog log = open({.log = write_candump(text)});
  MemoryTarget target;
  const PlaybackResult result = play_at_once(log, target, 2);
  EXPECT_EQ(result.sent, 2 * kFrames);
  EXPECT_EQ(result.passes, 2u);
  ASSERT_THAT(target.ids, SizeIs(2 * kFrames));
  for (std::uint32_t i = 0; i < 2 * kFrames; ++i) ASSERT_EQ(target.ids[i], i % kFrames);
}

TEST_F(PlaybackTest, SendsFramesOfOneStampTogetherAndCountsThemWithinBounds) {
  std::string text;
  for (int i = 0; i < 30'000; ++i) text += "(1.0) vcan0 101#\n";
  const PlaybackLog log = open({.log = write_candump(text + "(2.0) vcan0 102#\n")});
  EXPECT_EQ(log.outline().groups, 2u);
  MemoryTarget target;
  EXPECT_EQ(play_at_once(log, target).sent, 30'001u);
  EXPECT_EQ(target.group_sizes.back(), 1u);
  // Read ahead in pieces of a megabyte, however many frames have one stamp.
  EXPECT_GT(target.group_sizes.size(), 2u);
}

TEST_F(PlaybackTest, CountsWhatIsRefusedAndGoesOn) {
  const PlaybackLog log =
      open({.log = write_candump("(1.0) vcan0 101#\n(1.0) vcan0 102#\n(1.1) vcan0 103#\n")});
  MemoryTarget target;
  target.refused_id = 0x102;
  const PlaybackResult result = play_at_once(log, target);
  EXPECT_EQ(result.sent, 2u);
  EXPECT_EQ(result.refused, 1u);
  EXPECT_EQ(result.passes, 1u);
}

TEST_F(PlaybackTest, RecordsATimingErrorPerSendThatHasADeadline) {
  const PlaybackLog log =
      open({.log = write_candump("(1.0) vcan0 101#\n(1.0) vcan0 102#\n(1.01) vcan0 103#\n")});
  MemoryTarget target;
  const PlaybackResult result = play(log, target, {.speed = 2.0}, [](const PlaybackProgress&) {});
  EXPECT_EQ(result.lateness.count(), 2u);
  EXPECT_THAT(target.sent, ElementsAre("101@0", "102@0", "103@0"));
}

TEST_F(PlaybackTest, TimesNeverDecreaseAndDisorderIsCounted) {
  const PlaybackLog log = open({.log = write_candump("(10.0) vcan0 101#\n(10.3) vcan0 102#\n"
                                                     "(10.2) vcan0 103#\n(10.4) vcan0 104#\n")});
  EXPECT_THAT(times_of(log), ElementsAre(0, 300'000'000, 300'000'000, 400'000'000));
  EXPECT_EQ(log.outline().backwards, 1u);
}

TEST_F(PlaybackTest, DistancesCountBehindAClockThatWasSetBack) {
  const PlaybackLog log = open({.log = write_candump("(1000.0) vcan0 101#\n(1001.0) vcan0 102#\n"
                                                     "(5.0) vcan0 103#\n(5.5) vcan0 104#\n")});
  EXPECT_THAT(times_of(log), ElementsAre(0, 1'000'000'000, 1'000'000'000, 1'500'000'000));
  EXPECT_EQ(log.outline().backwards, 1u);
}

TEST_F(PlaybackTest, APassLastsAMeanDistanceLongerThanItsGroups) {
  const std::string file = write_candump("(1.0) vcan0 101#\n(1.1) vcan0 102#\n(1.2) vcan0 103#\n");
  EXPECT_EQ(open({.log = file}).period_ns(), 300'000'000);
  EXPECT_EQ(open({.log = file, .from_s = 0.1}).period_ns(), 200'000'000);
  EXPECT_EQ(open({.log = file, .to_s = 5.0}).period_ns(), 5'000'000'000);
}

TEST_F(PlaybackTest, BusesGoByNameWhereAllAreKnownElseInTheirOrder) {
  const std::string file = write_candump("(1.0) vcan1 101#\n(1.0) vcan0 102#\n(1.0) vcan1 103#\n");
  MemoryTarget by_name, by_order;
  static_cast<void>(play_at_once(open({.log = file, .buses = {"vcan0", "vcan1"}}), by_name));
  static_cast<void>(play_at_once(open({.log = file, .buses = {"udp0", "udp1"}}), by_order));
  EXPECT_THAT(by_name.sent, ElementsAre("101@1", "102@0", "103@1"));
  EXPECT_THAT(by_order.sent, ElementsAre("101@0", "102@1", "103@0"));
  EXPECT_THAT(refusal_of({.log = file}), HasSubstr("frames of bus 1 (vcan0) too"));
}

TEST_F(PlaybackTest, ACandumpLogBecomesMessagesOfOneStampAndBusEach) {
  const PlaybackLog log =
      open({.log = write_candump("(1.0) vcan0 101#AA\n(1.0) vcan0 102#\n(1.0) vcan1 103#\n"
                                 "(1.5) vcan1 104#\n"),
            .is_as_messages = true});
  MemoryTarget target;
  target.is_of_messages = true;
  static_cast<void>(play_at_once(log, target));
  std::vector<std::string> found;
  for (const std::vector<std::uint8_t>& message : target.messages) {
    FrameBatch batch;
    ASSERT_TRUE(decode_frames(message, batch));
    found.push_back(fmt::format("{}: bus {}, {} frames from {}", batch.sequence, batch.bus,
                                batch.frames.size(), batch.first_frame));
  }
  EXPECT_THAT(found, ElementsAre("0: bus 0, 2 frames from 0", "1: bus 1, 1 frames from 2",
                                 "2: bus 1, 1 frames from 3"));
}

TEST_F(PlaybackTest, MessagesOfALogAreSentAsTheyAreAndItsRunBeforeTheRest) {
  const std::string file = (folder_ / "messages.lcm").string();
  const auto sink = open_log(file);
  constexpr std::int64_t kBegin_us = 1'700'000'000'000'000;
  const std::vector<std::uint8_t> bytes{1, 2, 3};
  sink->publish(kRunChannel, kBegin_us, bytes);
  for (std::int64_t i = 1; i <= 4; ++i) sink->publish("POSE", kBegin_us + i * 100'000, bytes);
  sink->close();
  const PlaybackLog log = open({.log = file, .is_as_messages = true, .from_s = 0.15, .to_s = 0.35});
  EXPECT_THAT(times_of(log), ElementsAre(150'000'000, 200'000'000, 300'000'000));
  MemoryTarget target;
  target.is_of_messages = true;
  EXPECT_EQ(play_at_once(log, target).sent, 3u);
  EXPECT_THAT(target.sent, ElementsAre("FAULTLINE_RUN 3", "POSE 3", "POSE 3"));
  EXPECT_EQ(target.messages[1], bytes);
  EXPECT_THAT(refusal_of({.log = file, .is_as_messages = true, .channels = {"PSE"}}),
              HasSubstr("did you mean POSE?"));
}

TEST_F(PlaybackTest, StepsTakeWholeGroupsAndEndWhenToldTo) {
  const PlaybackLog log =
      open({.log = write_candump("(1.0) vcan0 101#\n(1.0) vcan0 102#\n(1.1) vcan0 103#\n"
                                 "(1.2) vcan0 104#\n(1.3) vcan0 105#\n")});
  MemoryTarget target;
  std::vector<std::uint64_t> answers{1, 2, 0};
  std::vector<double> shown;
  std::size_t asked = 0;
  const PlaybackResult result = play_stepwise(
      log, target, {}, [&] { return answers[asked++]; },
      [&shown](const PlaybackProgress& progress) { shown.push_back(progress.at_s); });
  EXPECT_THAT(target.sent, ElementsAre("101@0", "102@0", "103@0", "104@0"));
  EXPECT_THAT(shown, ElementsAre(0.0, testing::DoubleEq(0.1), testing::DoubleEq(0.2)));
  EXPECT_EQ(asked, 3u);
  EXPECT_EQ(result.sent, 4u);
}

TEST_F(PlaybackTest, StepsEndWithTheLog) {
  const PlaybackLog log = open({.log = write_candump("(1.0) vcan0 101#\n(1.1) vcan0 102#\n")});
  MemoryTarget target;
  const PlaybackResult result = play_stepwise(
      log, target, {}, [] { return 100; }, [](const PlaybackProgress&) {});
  EXPECT_EQ(result.sent, 2u);
}

}  // namespace
}  // namespace faultline

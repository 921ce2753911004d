#include "tools/bench/message_silence.h"

#include <chrono>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace faultline {
namespace {

using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr milliseconds kPeriod{10};

/// Two messages of the plant, one of the controller; no SYNC.
SignalMap three_messages() {
  SignalMap map;
  map.sensor_messages = {{.name = "S1", .id = 1}, {.name = "S2", .id = 2}};
  map.command_messages = {{.name = "C", .id = 3}};
  return map;
}

std::vector<std::string> texts(const std::vector<MessageSilence::Report>& reports) {
  std::vector<std::string> all;
  for (const MessageSilence::Report& report : reports) all.push_back(report.text);
  return all;
}

CanFrame frame(std::uint32_t id) {
  CanFrame made;
  made.id = id;
  return made;
}

TEST(MessageSilence, SaysOnceWhatIsMissedAndOnceThatItIsBack) {
  const SignalMap map = three_messages();
  MessageSilence silence(map, all_messages(map), kPeriod);
  const MessageSilence::Time begin{};
  EXPECT_THAT(texts(silence.look(begin)), IsEmpty());
  silence.count(frame(1));
  EXPECT_THAT(texts(silence.look(begin + milliseconds(400))), IsEmpty());
  EXPECT_FALSE(silence.is_any_missed());
  EXPECT_THAT(texts(silence.look(begin + milliseconds(600))), ElementsAre("no S2, C for 0.60 s"));
  EXPECT_THAT(texts(silence.look(begin + milliseconds(700))), IsEmpty());
  EXPECT_TRUE(silence.is_any_missed());
  EXPECT_THAT(texts(silence.look(begin + milliseconds(950))), ElementsAre("no S1 for 0.55 s"));
  silence.count(frame(2));
  silence.count(frame(7));  // nobody's
  EXPECT_THAT(texts(silence.look(begin + milliseconds(1000))), ElementsAre("S2 back after 1.00 s"));
  EXPECT_EQ(silence.silences(), 2U);
}

TEST(MessageSilence, MessagesSlowerThanTheCycleAreGivenTwentyOfTheirOwnPeriods) {
  SignalMap map = three_messages();
  map.sensor_messages[1].cycles_per_frame = 10;
  MessageSilence silence(map, messages_of_plant(map), kPeriod);
  const MessageSilence::Time begin{};
  EXPECT_THAT(texts(silence.look(begin)), IsEmpty());
  EXPECT_THAT(texts(silence.look(begin + milliseconds(600))), ElementsAre("no S1 for 0.60 s"));
  EXPECT_THAT(texts(silence.look(begin + milliseconds(1900))), IsEmpty());
  EXPECT_THAT(texts(silence.look(begin + milliseconds(2100))), ElementsAre("no S2 for 2.10 s"));
}

TEST(MessageSilence, SlowBenchesAreGivenTwentyPeriods) {
  const SignalMap map = three_messages();
  MessageSilence silence(map, messages_of_controller(map), milliseconds(100));
  const MessageSilence::Time begin{};
  EXPECT_THAT(texts(silence.look(begin)), IsEmpty());
  EXPECT_THAT(texts(silence.look(begin + milliseconds(2000))), IsEmpty());
  EXPECT_THAT(texts(silence.look(begin + milliseconds(2001))), ElementsAre("no C for 2.00 s"));
}

}  // namespace
}  // namespace faultline

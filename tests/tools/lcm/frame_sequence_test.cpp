#include "tools/lcm/frame_sequence.h"

#include <limits>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

/// A message `sequence` with `frames` frames, of which the first has the number `first_frame`.
FrameBatch message(std::int64_t sequence, std::int64_t first_frame, std::int32_t frames = 2) {
  FrameBatch batch;
  batch.utime = first_frame / 2;
  batch.sequence = sequence;
  batch.first_frame = first_frame;
  batch.frame_count = frames;
  batch.frames.resize(static_cast<std::size_t>(frames));
  return batch;
}

/// The n-th message of two frames each.
FrameBatch nth(std::int64_t n) { return message(n, 2 * n); }

class FrameSequenceTest : public testing::Test {
 protected:
  std::vector<std::string> told_;
  FrameSequence sequence_{{.on_batch =
                               [this](const FrameBatch& batch) {
                                 told_.push_back(fmt::format("{}", batch.first_frame));
                               },
                           .on_gap =
                               [this](const FrameGap& gap) {
                                 told_.push_back(fmt::format("gap at {}: {} frames, {} messages",
                                                             gap.first_frame, gap.frames,
                                                             gap.lost_messages));
                               },
                           .on_restart = [this] { told_.emplace_back("restart"); }}};
};

TEST_F(FrameSequenceTest, HandsOnWhatComesInOrder) {
  for (std::int64_t n = 5; n < 8; ++n) sequence_.push(nth(n));
  EXPECT_THAT(told_, ElementsAre("10", "12", "14"));
  EXPECT_EQ(sequence_.counters().messages, 3u);
}

TEST_F(FrameSequenceTest, PutsSwappedMessagesInOrder) {
  for (const std::int64_t n : {0, 2, 3, 1, 4}) sequence_.push(nth(n));
  EXPECT_THAT(told_, ElementsAre("0", "2", "4", "6", "8"));
  EXPECT_FALSE(sequence_.is_waiting());
  EXPECT_EQ(sequence_.counters().lost_messages, 0u);
}

TEST_F(FrameSequenceTest, TellsWhatWasLostWhenItIsGivenUp) {
  for (const std::int64_t n : {0, 3, 4}) sequence_.push(nth(n));
  EXPECT_THAT(told_, ElementsAre("0"));
  EXPECT_TRUE(sequence_.is_waiting());
  sequence_.give_up();
  EXPECT_THAT(told_, ElementsAre("0", "gap at 2: 4 frames, 2 messages", "6", "8"));
  EXPECT_EQ(sequence_.counters().lost_messages, 2u);
  EXPECT_EQ(sequence_.counters().missing_frames, 4u);
}

TEST_F(FrameSequenceTest, WaitsForNoMoreThanItMayHold) {
  sequence_.push(nth(0));
  constexpr auto kMost = static_cast<std::int64_t>(FrameSequence::kMostHeld);
  for (std::int64_t n = 2; n <= kMost + 1; ++n) sequence_.push(nth(n));
  EXPECT_THAT(told_, ElementsAre("0"));
  sequence_.push(nth(kMost + 2));
  EXPECT_EQ(told_[1], "gap at 2: 2 frames, 1 messages");
  EXPECT_EQ(told_.size(), 2u + FrameSequence::kMostHeld + 1u);
  EXPECT_FALSE(sequence_.is_waiting());
}

TEST_F(FrameSequenceTest, CountsLateMessagesAndCopiesAndDoesNotUseThem) {
  for (const std::int64_t n : {0, 2}) sequence_.push(nth(n));
  sequence_.give_up();
  told_.clear();
  sequence_.push(nth(1));
  sequence_.push(nth(2));
  EXPECT_THAT(told_, IsEmpty());
  EXPECT_EQ(sequence_.counters().late_messages, 1u);
  EXPECT_EQ(sequence_.counters().repeated_messages, 1u);
}

TEST_F(FrameSequenceTest, CountsACopyOfAHeldMessageOnce) {
  for (const std::int64_t n : {0, 2, 2, 1}) sequence_.push(nth(n));
  EXPECT_THAT(told_, ElementsAre("0", "2", "4"));
  EXPECT_EQ(sequence_.counters().repeated_messages, 1u);
}

TEST_F(FrameSequenceTest, TellsFramesThatWereDroppedBeforeTheyWereSent) {
  sequence_.push(message(0, 0));
  sequence_.push(message(1, 7));
  EXPECT_THAT(told_, ElementsAre("0", "gap at 2: 5 frames, 0 messages", "7"));
  EXPECT_EQ(sequence_.counters().missing_frames, 5u);
  EXPECT_EQ(sequence_.counters().lost_messages, 0u);
}

TEST_F(FrameSequenceTest, StartsAgainWhereTheNumbersBeginAgain) {
  for (std::int64_t n = 0; n < 40; ++n) sequence_.push(nth(n));
  told_.clear();
  sequence_.push(nth(0));
  sequence_.push(nth(1));
  EXPECT_THAT(told_, ElementsAre("restart", "0", "2"));
  EXPECT_EQ(sequence_.counters().restarts, 1u);
}

TEST_F(FrameSequenceTest, HandsOnWhatItHoldsBeforeARestart) {
  for (std::int64_t n = 0; n < 20; ++n) sequence_.push(nth(n));
  sequence_.push(nth(21));
  told_.clear();
  sequence_.push(nth(0));
  EXPECT_THAT(told_, ElementsAre("gap at 40: 2 frames, 1 messages", "42", "restart", "0"));
}

TEST_F(FrameSequenceTest, FramesThatGoBackUnderRisingMessagesAreARestart) {
  sequence_.push(message(0, 100));
  sequence_.push(message(1, 0));
  EXPECT_THAT(told_, ElementsAre("100", "restart", "0"));
}

TEST_F(FrameSequenceTest, MissesTheLastMessagesOnceTheirNumberIsKnown) {
  for (const std::int64_t n : {0, 1}) sequence_.push(nth(n));
  sequence_.give_up();
  EXPECT_FALSE(sequence_.is_waiting());
  sequence_.announce_end(4);
  EXPECT_TRUE(sequence_.is_waiting());
  sequence_.give_up();
  EXPECT_THAT(told_, ElementsAre("0", "2", "gap at 4: 0 frames, 2 messages"));
  EXPECT_EQ(sequence_.counters().lost_messages, 2u);
  sequence_.push(nth(2));
  EXPECT_EQ(sequence_.counters().late_messages, 1u);
}

TEST_F(FrameSequenceTest, MissesNothingWhereAllMessagesCame) {
  sequence_.announce_end(2);
  for (const std::int64_t n : {0, 1}) sequence_.push(nth(n));
  sequence_.give_up();
  EXPECT_THAT(told_, ElementsAre("0", "2"));
}

TEST_F(FrameSequenceTest, TakesNoNumbersThatNobodyCountsTo) {
  constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
  sequence_.push(nth(0));
  for (const FrameBatch& bad :
       {message(kMost, 2), message(1, kMost), message(-1, 2), message(1, -1)}) {
    sequence_.push(bad);
  }
  sequence_.push(nth(1));
  EXPECT_THAT(told_, ElementsAre("0", "2"));
  EXPECT_EQ(sequence_.counters().malformed_messages, 4u);
}

}  // namespace
}  // namespace faultline

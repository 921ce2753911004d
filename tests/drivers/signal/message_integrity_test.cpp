#include "drivers/signal/message_integrity.h"

#include <cstdint>
#include <deque>
#include <limits>
#include <random>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "drivers/dbc/dbc_parser.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using enum IntegrityStatus;

/// A message of 8 bytes with a counter of `bits` from bit 0 on, and no checksum.
MessageProtection counter_of(unsigned bits, const std::string& range = "[0|0]") {
  const DbcDatabase dbc = parse_dbc(
      fmt::format(
          "BO_ 1 M: 8 N\n SG_ n : 0|{}@1+ (1,0) {} \"\" N\n"
          "BA_DEF_ SG_ \"FaultlineRole\" STRING ;\nBA_ \"FaultlineRole\" SG_ 1 n \"alive\";\n",
          bits, range),
      "m.dbc");
  return compile_protection(dbc, dbc.messages.front());
}

/// A message of 8 bytes with E2E profile 1A: checksum in byte 0, counter in byte 1.
MessageProtection profile_1() {
  const DbcDatabase dbc = parse_dbc(
      "BO_ 1 M: 8 N\n SG_ crc : 0|8@1+ (1,0) [0|0] \"\" N\n SG_ n : 8|4@1+ (1,0) [0|0] \"\" N\n"
      "BA_DEF_ SG_ \"FaultlineRole\" STRING ;\nBA_DEF_ BO_ \"FaultlineProtection\" STRING ;\n"
      "BA_DEF_ BO_ \"FaultlineDataId\" INT 0 65535;\nBA_ \"FaultlineRole\" SG_ 1 n \"alive\";\n"
      "BA_ \"FaultlineRole\" SG_ 1 crc \"crc\";\nBA_ \"FaultlineProtection\" BO_ 1 \"E2E_P01A\";\n"
      "BA_ \"FaultlineDataId\" BO_ 1 4660;\n",
      "m.dbc");
  return compile_protection(dbc, dbc.messages.front());
}

CanFrame frame_of(const MessageProtection& protection, std::uint64_t count) {
  CanFrame frame;
  frame.length = 8;
  protection.write(std::span(frame.data).first(8), count);
  return frame;
}

/// A receiver that is shown counters.
struct Receiver {
  explicit Receiver(const MessageProtection& description)
      : protection(description), integrity(description) {}
  IntegrityResult count(std::uint64_t counter) {
    return integrity.check(frame_of(protection, counter));
  }
  IntegrityResult corrupted(std::uint64_t counter) {
    CanFrame frame = frame_of(protection, counter);
    frame.data[7] ^= 1;
    return integrity.check(frame);
  }
  IntegrityResult cut(std::uint64_t counter) {
    CanFrame frame = frame_of(protection, counter);
    frame.length = 7;
    return integrity.check(frame);
  }
  MessageProtection protection;
  MessageIntegrity integrity;
};

TEST(MessageIntegrity, AcceptsTheFirstFrameWhateverItsCounter) {
  for (std::uint64_t first = 0; first < 16; ++first) {
    Receiver receiver(counter_of(4));
    EXPECT_EQ(receiver.count(first).status, kOk);
    EXPECT_EQ(receiver.count((first + 1) % 16).status, kOk);
  }
}

TEST(MessageIntegrity, CountsTheFramesOfAGapAndGoesOnBehindIt) {
  Receiver receiver(counter_of(4));
  receiver.count(14);
  EXPECT_EQ(receiver.count(2), (IntegrityResult{kCounterGap, 3}));  // 15, 0, 1
  EXPECT_EQ(receiver.count(3).status, kOk);
  EXPECT_EQ(receiver.integrity.counters().gaps, 1U);
  EXPECT_EQ(receiver.integrity.counters().lost, 3U);
  EXPECT_EQ(receiver.integrity.counters().bad_frames(), 0U);
}

TEST(MessageIntegrity, CallsAFrozenCounterARepeatEachTime) {
  Receiver receiver(counter_of(8));
  receiver.count(7);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(receiver.count(7).status, kCounterRepeated);
  EXPECT_EQ(receiver.count(8).status, kOk);
  EXPECT_EQ(receiver.integrity.counters().repeated, 100U);
}

TEST(MessageIntegrity, WrapsWhereTheSequenceEnds) {
  Receiver profile(profile_1());
  for (std::uint64_t i = 0; i < 100; ++i) EXPECT_EQ(profile.count(i % 15).status, kOk);
  Receiver ranged(counter_of(4, "[0|9]"));
  for (std::uint64_t i = 0; i < 100; ++i) EXPECT_EQ(ranged.count(i % 10).status, kOk);
  EXPECT_EQ(ranged.count(12).status, kCounterOutOfRange);
}

TEST(MessageIntegrity, RefusesTheReservedCounterOfProfile1) {
  Receiver receiver(profile_1());
  receiver.count(14);
  EXPECT_EQ(receiver.count(15).status, kCounterOutOfRange);
  EXPECT_EQ(receiver.integrity.counters().out_of_range, 1U);
}

TEST(MessageIntegrity, FollowsCountersOfEveryWidth) {
  for (unsigned bits = 2; bits <= 64; ++bits) {
    Receiver receiver(counter_of(bits));
    const std::uint64_t last = ~std::uint64_t{0} >> (64 - bits);
    EXPECT_EQ(receiver.count(last).status, kOk) << bits;
    EXPECT_EQ(receiver.count(0).status, kOk) << bits;
    EXPECT_EQ(receiver.count(2), (IntegrityResult{kCounterGap, 1})) << bits;
    EXPECT_EQ(receiver.count(2).status, kCounterRepeated) << bits;
    EXPECT_EQ(receiver.count(3).status, kOk) << bits;
  }
  Receiver toggle(counter_of(1));
  for (std::uint64_t i = 0; i < 10; ++i) EXPECT_EQ(toggle.count(i % 2).status, kOk);
  EXPECT_EQ(toggle.count(1).status, kCounterRepeated);
}

TEST(MessageIntegrity, DoesNotTakeARestartOfAWideCounterForLostFrames) {
  Receiver receiver(counter_of(32));
  receiver.count(1'000'000);
  EXPECT_EQ(receiver.count(0), (IntegrityResult{kCounterGap, 0}));
  EXPECT_EQ(receiver.count(1).status, kOk);
  EXPECT_EQ(receiver.integrity.counters().restarts, 1U);
  EXPECT_EQ(receiver.integrity.counters().lost, 0U);
  Receiver narrow(counter_of(8));
  narrow.count(200);
  EXPECT_EQ(narrow.count(150), (IntegrityResult{kCounterGap, 205}));
}

TEST(MessageIntegrity, KnowsThatCorruptedFramesWereNotLost) {
  Receiver receiver(profile_1());
  receiver.count(3);
  EXPECT_EQ(receiver.corrupted(4).status, kWrongCrc);
  EXPECT_EQ(receiver.cut(5).status, kTooShort);
  EXPECT_EQ(receiver.count(6).status, kOk);
  EXPECT_EQ(receiver.corrupted(7).status, kWrongCrc);
  EXPECT_EQ(receiver.count(10), (IntegrityResult{kCounterGap, 2}));  // 8 and 9
  const IntegrityCounters& counters = receiver.integrity.counters();
  EXPECT_EQ(counters.wrong_crc, 2U);
  EXPECT_EQ(counters.too_short, 1U);
  EXPECT_EQ(counters.lost, 2U);
  EXPECT_EQ(counters.bad_frames(), 3U);
  EXPECT_EQ(counters.frames, 6U);
}

TEST(MessageIntegrity, TellsNothingAfterAWholeSequenceOfCorruptedFrames) {
  Receiver receiver(profile_1());
  receiver.count(3);
  for (std::uint64_t i = 0; i < 14; ++i) receiver.corrupted((4 + i) % 15);
  EXPECT_EQ(receiver.count(3).status, kOk);  // the fifteenth since: not a repeat
  EXPECT_EQ(receiver.count(3).status, kCounterRepeated);
}

TEST(MessageIntegrity, StillSeesARepeatAmongCorruptedFrames) {
  Receiver receiver(profile_1());
  receiver.count(3);
  receiver.corrupted(4);
  EXPECT_EQ(receiver.count(3).status, kCounterRepeated);
  EXPECT_EQ(receiver.count(5).status, kOk);
}

TEST(MessageIntegrity, DoesNotBeginWithACorruptedFrame) {
  Receiver receiver(profile_1());
  EXPECT_EQ(receiver.corrupted(9).status, kWrongCrc);
  EXPECT_EQ(receiver.count(2).status, kOk);
}

TEST(MessageIntegrity, FindsNothingWrongWithAnUnprotectedMessage) {
  MessageIntegrity integrity;
  CanFrame frame;
  for (int i = 0; i < 3; ++i) EXPECT_EQ(integrity.check(frame).status, kOk);
  EXPECT_EQ(integrity.counters().frames, 3U);
}

TEST(MessageIntegrity, ForgetsEverythingOnReset) {
  Receiver receiver(profile_1());
  receiver.count(3);
  receiver.count(3);
  receiver.integrity.reset();
  EXPECT_EQ(receiver.integrity.counters().repeated, 0U);
  EXPECT_EQ(receiver.count(3).status, kOk);
}

TEST(MessageIntegrity, CountsLostFramesUpToTheEndOfItsNumbers) {
  Receiver receiver(counter_of(15));
  std::uint64_t expected = 0;
  std::uint64_t at = 0;
  receiver.count(at);
  for (int i = 0; i < 1000; ++i) {
    at = (at + 32767) % 32768;
    EXPECT_EQ(receiver.count(at).lost, 32766U);
    expected += 32766;
  }
  EXPECT_EQ(receiver.integrity.counters().lost, expected);
}

// What is lost, doubled and corrupted on the way adds up: every frame sent is received or lost.
TEST(MessageIntegrity, AccountsForEveryFrameOfARandomChannel) {
  const std::uint64_t seed = test_seed(7);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937 draw(static_cast<std::uint32_t>(seed));
  for (const MessageProtection& protection : {profile_1(), counter_of(8), counter_of(64)}) {
    MessageProtector sender(protection);
    MessageIntegrity receiver(protection);
    std::uint64_t dropped = 0, doubled = 0, corrupted = 0;
    std::uint64_t lost_in_a_row = 0;
    for (int i = 0; i < 20'000; ++i) {
      CanFrame frame;
      frame.length = 8;
      frame.data[7] = static_cast<std::uint8_t>(draw());
      sender.protect(frame);
      const auto fate = draw() % 20;
      const bool may_lose =
          i > 0 && lost_in_a_row < 6;  // fewer than a sequence: else none can tell
      if (fate == 0 && may_lose) {
        ++dropped;
        ++lost_in_a_row;
        continue;
      }
      if (fate == 1 && may_lose && protection.has_crc()) {
        frame.data[7] ^= 0x10;
        EXPECT_EQ(receiver.check(frame).status, kWrongCrc);
        ++corrupted;
        ++lost_in_a_row;
        continue;
      }
      EXPECT_TRUE(is_usable(receiver.check(frame).status));
      lost_in_a_row = 0;
      if (fate == 2) {
        EXPECT_EQ(receiver.check(frame).status, kCounterRepeated);
        ++doubled;
      }
    }
    // The last ones may not have been missed yet.
    EXPECT_LE(receiver.counters().lost, dropped);
    EXPECT_GE(receiver.counters().lost + lost_in_a_row, dropped);
    EXPECT_EQ(receiver.counters().repeated, doubled);
    EXPECT_EQ(receiver.counters().wrong_crc, corrupted);
  }
}

TEST(MessageProtector, NeverSendsAFrameThatItsReceiverRefuses) {
  for (const MessageProtection& protection :
       {profile_1(), counter_of(1), counter_of(4, "[0|9]"), counter_of(33), counter_of(64)}) {
    MessageProtector sender(protection);
    MessageIntegrity receiver(protection);
    for (int i = 0; i < 1000; ++i) {
      CanFrame frame;
      frame.length = 8;
      sender.protect(frame);
      EXPECT_EQ(receiver.check(frame).status, kOk);
    }
  }
}

TEST(MessageProtector, LeavesAFrameThatIsTooShort) {
  MessageProtector sender(profile_1());
  CanFrame frame;
  frame.length = 7;
  sender.protect(frame);
  EXPECT_EQ(frame.data, CanFrame{}.data);
}

TEST(MessageIntegrity, NeitherChecksNorProtectsOnTheHeap) {
  MessageProtector sender(profile_1());
  MessageIntegrity receiver(profile_1());
  std::uint64_t bad = 0;
  const AllocationGuard guard;
  for (int i = 0; i < 1000; ++i) {
    CanFrame frame;
    frame.length = 8;
    sender.protect(frame);
    if (i % 3 == 0) frame.data[3] ^= 4;
    if (i % 50 == 0) frame.length = 3;
    bad += is_usable(receiver.check(frame).status) ? 0U : 1U;
  }
  const std::uint64_t calls = guard.heap_calls();
  EXPECT_EQ(calls, 0U);
  EXPECT_GT(bad, 300U);
}

}  // namespace
}  // namespace faultline

#include "tools/bench/stage_latencies.h"

#include <string>

#include <gtest/gtest.h>

#include "tools/bench/bus_silence.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;
using std::chrono::nanoseconds;
using std::chrono::steady_clock;
using std::chrono::system_clock;

const LatencyHistogram& of(const StageLatencies& latencies, const std::string& stage) {
  for (const StageLatency& found : latencies.stages()) {
    if (found.stage == stage) return found.histogram;
  }
  ADD_FAILURE() << "no stage " << stage;
  return latencies.stages().front().histogram;
}

/// A sample of a frame that the kernel stamped `at` after the beginning, read 10 µs later.
class StageLatenciesTest : public testing::Test {
 protected:
  StageLatenciesTest() : record_(Bank{}) {
    // Read the two clocks at once, as far as they can be: not with an interruption between.
    do {
      begin_ = steady_clock::now();
      begin_real_ = system_clock::now();
    } while (steady_clock::now() - begin_ > 8us);
  }

  void take(std::uint32_t cycle, nanoseconds at, bool has_stages = true) {
    record_.cycle = cycle;
    record_.stamp = std::chrono::time_point_cast<nanoseconds>(begin_real_ + at);
    StageTimes times;
    times.is_closed_by_frame = true;
    times.has_stages = has_stages;
    times.read = begin_ + at + 10us;
    times.decoded = times.read + 1us;
    times.stepped = times.decoded + 2us;
    times.decided = times.stepped + 3us;
    times.queued = times.decided + 4us;
    latencies_.on_record(record_, times, times.queued + 80us);
  }

  StageLatencies latencies_{1ms, 1, false};
  steady_clock::time_point begin_;
  system_clock::time_point begin_real_;
  DiagnosisRecord record_;
};

TEST_F(StageLatenciesTest, TellsTheStagesApart) {
  for (std::uint32_t k = 0; k < 10; ++k) take(k, k * 1ms);
  latencies_.finish();
  EXPECT_EQ(of(latencies_, "read->decoded").max(), 1us);
  EXPECT_EQ(of(latencies_, "decoded->stepped").max(), 2us);
  EXPECT_EQ(of(latencies_, "stepped->decided").max(), 3us);
  EXPECT_EQ(of(latencies_, "decided->queued").max(), 4us);
  EXPECT_EQ(of(latencies_, "queued->published").max(), 80us);
  for (const char* stage : {"stamp->read", "total", "end to end"}) {
    EXPECT_EQ(of(latencies_, stage).count(), 10U);
    EXPECT_EQ(of(latencies_, stage).corrected(), 0U);
  }
  // Both start at the same stamp: their difference needs no comparison of clocks.
  EXPECT_EQ(of(latencies_, "total").max() - of(latencies_, "stamp->read").max(), 10us);
  EXPECT_EQ(of(latencies_, "end to end").max() - of(latencies_, "total").max(), 80us);
}

TEST_F(StageLatenciesTest, CountsCyclesThatTheSameFrameClosedAsLateByTheirPeriods) {
  take(0, 0ms);
  take(1, 4ms);  // the frame of cycle 5 closes 1, 2 and 3
  take(2, 4ms);
  take(3, 4ms);
  take(4, 5ms);
  latencies_.finish();
  const LatencyHistogram& read = of(latencies_, "stamp->read");
  EXPECT_EQ(read.count(), 5U);
  EXPECT_EQ(read.corrected(), 2U);
  EXPECT_GE(read.max(), 2ms);
  EXPECT_LT(read.max(), 3ms);
}

TEST_F(StageLatenciesTest, CountsCyclesWithoutASampleButNotMoreThanThereWasTimeFor) {
  take(0, 0ms);
  take(20, 20ms);         // a gap
  take(1'000'000, 21ms);  // the plant starts anew
  take(3, 22ms);
  latencies_.finish();
  EXPECT_EQ(of(latencies_, "total").corrected(), 20U);
  EXPECT_EQ(of(latencies_, "total").count(), 24U);
}

TEST_F(StageLatenciesTest, CountsASkippedCycleAsSentWithTheNext) {
  latencies_.on_sent(100us);
  latencies_.on_skipped();
  latencies_.on_skipped();
  latencies_.on_sent(200us);
  const LatencyHistogram& sent = of(latencies_, "due->sent");
  EXPECT_EQ(sent.count(), 4U);
  EXPECT_EQ(sent.corrected(), 2U);
  EXPECT_EQ(sent.max(), 2200us);
}

TEST_F(StageLatenciesTest, LeavesOutWhatWasNotTimed) {
  take(0, 0ms, false);
  take(1, 1ms, true);
  latencies_.finish();
  EXPECT_EQ(of(latencies_, "stamp->read").count(), 2U);
  EXPECT_EQ(of(latencies_, "read->decoded").count(), 1U);
  EXPECT_EQ(of(latencies_, "total").count(), 1U);
}

TEST(TimedSamples, AreFewerWhereTheClockIsDear) {
  EXPECT_EQ(cycles_per_timed_sample(25ns, 1ms), 1U);
  EXPECT_EQ(cycles_per_timed_sample(25ns, 10us), 1U);
  EXPECT_EQ(cycles_per_timed_sample(13'500ns, 1ms), 6U);
  EXPECT_EQ(cycles_per_timed_sample(13'500ns, 5ms), 2U);
  EXPECT_EQ(cycles_per_timed_sample(1s, 1us), 1000U);
}

TEST(BusSilence, IsToldOnceAndSoIsItsEnd) {
  BusSilence silence(100ms);  // 20 periods: 2 s
  const steady_clock::time_point begin{};
  EXPECT_FALSE(silence.look(0, begin));
  EXPECT_FALSE(silence.look(0, begin + 2s));
  EXPECT_EQ(silence.look(0, begin + 2001ms).value(), "bus silent: no frame for 2.00 s");
  EXPECT_FALSE(silence.look(0, begin + 9s));
  EXPECT_EQ(silence.look(1, begin + 10s).value(), "bus is back: a frame came after 10.00 s");
  EXPECT_FALSE(silence.look(1, begin + 12s));
  EXPECT_TRUE(silence.look(1, begin + 13s));
}

TEST(BusSilence, LastsHalfASecondAtLeast) {
  BusSilence silence(1ms);
  const steady_clock::time_point begin{};
  EXPECT_FALSE(silence.look(5, begin));
  EXPECT_FALSE(silence.look(5, begin + 500ms));
  EXPECT_TRUE(silence.look(5, begin + 501ms));
}

}  // namespace
}  // namespace faultline

#include "drivers/signal/period_statistics.h"

#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "drivers/dbc/dbc_parser.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

Timestamp at_ns(std::int64_t time_ns) { return Timestamp(nanoseconds(time_ns)); }
Timestamp at_ms(std::int64_t time_ms) { return Timestamp(milliseconds(time_ms)); }

std::uint64_t total(const PeriodStatistics& statistics) {
  return std::accumulate(statistics.jitter().begin(), statistics.jitter().end(), std::uint64_t{0});
}

nanoseconds period_in(const std::string& attribute) {
  const DbcDatabase dbc =
      parse_dbc("BO_ 1 M: 8 N\n SG_ s : 0|8@1+ (1,0) [0|0] \"\" N\n" + attribute, "m.dbc");
  return period_of(dbc, dbc.messages.front());
}

TEST(PeriodOf, ReadsGenMsgCycleTimeInMilliseconds) {
  const std::string integer =
      "BA_DEF_ BO_ \"GenMsgCycleTime\" INT 0 65535;\nBA_DEF_DEF_ \"GenMsgCycleTime\" 0;\n";
  const std::string number = "BA_DEF_ BO_ \"GenMsgCycleTime\" FLOAT 0 65535;\n";
  EXPECT_EQ(period_in(integer), nanoseconds(0));
  EXPECT_EQ(period_in(integer + "BA_ \"GenMsgCycleTime\" BO_ 1 20;\n"), milliseconds(20));
  EXPECT_EQ(period_in(number + "BA_ \"GenMsgCycleTime\" BO_ 1 2.5;\n"), nanoseconds(2'500'000));
  EXPECT_EQ(period_in(integer + "BA_ \"GenMsgCycleTime\" BO_ 1 -20;\n"), nanoseconds(0));
  EXPECT_EQ(period_in(number + "BA_ \"GenMsgCycleTime\" BO_ 1 1e300;\n"), nanoseconds(0));
  EXPECT_EQ(period_in("BA_DEF_ BO_ \"GenMsgCycleTime\" STRING ;\n"
                      "BA_ \"GenMsgCycleTime\" BO_ 1 \"20\";\n"),
            nanoseconds(0));
  EXPECT_EQ(period_in(""), nanoseconds(0));
}

TEST(PeriodStatistics, CountsEarlyLateAndLostFrames) {
  PeriodStatistics statistics(milliseconds(10));
  for (const std::int64_t time_ms : {0, 10, 20, 22, 30, 61, 70}) statistics.add(at_ms(time_ms));
  EXPECT_EQ(statistics.frames(), 7U);
  EXPECT_EQ(statistics.intervals(), 6U);
  EXPECT_EQ(statistics.early(), 1U);  // 2 ms
  EXPECT_EQ(statistics.late(), 1U);   // 31 ms
  EXPECT_EQ(statistics.lost(), 2U);   // at 40 and 50 ms
  EXPECT_EQ(statistics.least(), milliseconds(2));
  EXPECT_EQ(statistics.greatest(), milliseconds(31));
  EXPECT_NEAR(statistics.mean_s(), 70e-3 / 6, 1e-12);
}

TEST(PeriodStatistics, PutsEveryIntervalIntoOneBin) {
  PeriodStatistics statistics(milliseconds(100));
  std::int64_t now_ms = 0;
  statistics.add(at_ms(now_ms));
  // -0.51, -0.5 (its own lower edge), -0.015, 0, 0.01, 0.019, 0.3, 0.5, 2
  for (const std::int64_t gap_ms : {49, 50, 100, 130, 150, 300}) {
    statistics.add(at_ms(now_ms += gap_ms));
  }
  const PeriodStatistics::JitterHistogram expected{1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 2};
  EXPECT_EQ(statistics.jitter(), expected);
  EXPECT_EQ(statistics.early(), statistics.jitter().front());
  EXPECT_EQ(statistics.late(), 1U);  // 150 is not: it is exactly 1.5 periods
}

TEST(PeriodStatistics, KeepsOnlyTimesWithoutAPeriod) {
  PeriodStatistics statistics;
  for (const std::int64_t time_ms : {0, 1, 100}) statistics.add(at_ms(time_ms));
  EXPECT_FALSE(statistics.has_period());
  EXPECT_EQ(statistics.intervals(), 2U);
  EXPECT_EQ(statistics.early() + statistics.late() + statistics.lost() + total(statistics), 0U);
  EXPECT_EQ(statistics.greatest(), milliseconds(99));
}

TEST(PeriodStatistics, SaysNothingBeforeTheSecondFrame) {
  PeriodStatistics statistics(milliseconds(1));
  EXPECT_EQ(statistics.deviation_s(), 0.0);
  statistics.add(at_ms(5));
  EXPECT_EQ(statistics.intervals(), 0U);
  EXPECT_EQ(statistics.mean_s(), 0.0);
  EXPECT_EQ(statistics.least(), nanoseconds(0));
}

TEST(PeriodStatistics, GoesOnBehindAClockThatWasSetBack) {
  PeriodStatistics statistics(milliseconds(10));
  for (const std::int64_t time_ms : {1000, 1010, 500, 510, 520}) statistics.add(at_ms(time_ms));
  EXPECT_EQ(statistics.backward(), 1U);
  EXPECT_EQ(statistics.intervals(), 3U);
  EXPECT_EQ(statistics.greatest(), milliseconds(10));
  EXPECT_EQ(statistics.late() + statistics.early() + statistics.lost(), 0U);
}

TEST(PeriodStatistics, SurvivesStampsFromTheEndsOfTime) {
  constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min();
  constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
  PeriodStatistics statistics(nanoseconds(1));
  for (const std::int64_t time_ns : {kLeast, kMost, kLeast, std::int64_t{0}, kMost, kMost}) {
    statistics.add(at_ns(time_ns));
  }
  EXPECT_EQ(statistics.frames(), 6U);
  EXPECT_EQ(statistics.backward(), 1U);
  EXPECT_EQ(statistics.intervals(), 4U);
  EXPECT_TRUE(std::isfinite(statistics.deviation_s()));
}

TEST(PeriodStatistics, AgreesWithTheDefinitionsOnRandomTimes) {
  const std::uint64_t seed = test_seed(3);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 draw(seed);
  for (int round = 0; round < 50; ++round) {
    constexpr std::int64_t kPeriod_ns = 10'000'000;
    PeriodStatistics statistics{nanoseconds(kPeriod_ns)};
    std::vector<double> gaps_s;
    std::uint64_t early = 0, late = 0, lost = 0;
    std::int64_t now_ns = static_cast<std::int64_t>(draw() % 1'000'000'000);
    statistics.add(at_ns(now_ns));
    for (int i = 0; i < 200; ++i) {
      const auto gap_ns = static_cast<std::int64_t>(draw() % (5 * kPeriod_ns));
      statistics.add(at_ns(now_ns += gap_ns));
      gaps_s.push_back(static_cast<double>(gap_ns) * 1e-9);
      if (2 * gap_ns < kPeriod_ns) ++early;
      if (2 * gap_ns > 3 * kPeriod_ns) {
        ++late;
        lost += static_cast<std::uint64_t>((gap_ns + kPeriod_ns / 2) / kPeriod_ns) - 1;
      }
    }
    const double n = static_cast<double>(gaps_s.size());
    const double mean_s = std::accumulate(gaps_s.begin(), gaps_s.end(), 0.0) / n;
    double squares = 0.0;
    for (const double gap_s : gaps_s) squares += (gap_s - mean_s) * (gap_s - mean_s);
    EXPECT_NEAR(statistics.mean_s(), mean_s, 1e-12);
    EXPECT_NEAR(statistics.deviation_s(), std::sqrt(squares / n), 1e-12);
    EXPECT_EQ(statistics.early(), early);
    EXPECT_EQ(statistics.late(), late);
    EXPECT_EQ(statistics.lost(), lost);
    EXPECT_EQ(total(statistics), statistics.intervals());
  }
}

TEST(PeriodStatistics, DoesNotAllocate) {
  PeriodStatistics statistics(milliseconds(1));
  const AllocationGuard guard;
  for (std::int64_t i = 0; i < 1000; ++i) statistics.add(at_ms(i * i % 977));
  EXPECT_EQ(guard.heap_calls(), 0U);
}

}  // namespace
}  // namespace faultline

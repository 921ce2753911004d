#include "sim/recorded_signal.h"

#include <cmath>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/input_error.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using enum RecordedSignal::Between;

RecordedSignal record(const std::string& text) { return {text, "wind.csv"}; }

std::string refusal(const std::string& text) {
  try {
    const RecordedSignal signal(text, "wind.csv");
  } catch (const InputError& error) {
    return error.what();
  }
  return "it was taken";
}

/// Rows at 0, 0.01, .. but for those from `gap_from` on, which come `jump_s` later.
std::string regular(int rows, int gap_from, double jump_s) {
  std::string text = "t_s,a\n";
  for (int row = 0; row < rows; ++row) {
    text += fmt::format("{:.6f},{}\n", 0.01 * row + (row >= gap_from ? jump_s : 0.0), row);
  }
  return text;
}

TEST(RecordedSignal, IsWhatItsRowsSayAndALineBetweenThem) {
  const RecordedSignal signal = record("t_s, a,b\r\n5,1,10\r\n 6 ,2,20\r\n8,-2,30\r\n");
  EXPECT_THAT(signal.names(), ElementsAre("a", "b"));
  EXPECT_EQ(signal.length_s(), 3.0);
  EXPECT_EQ(signal.value(0, 0.0, kLinear, false), 1.0);
  EXPECT_NEAR(signal.value(0, 0.25, kLinear, false), 1.25, 1e-12);
  EXPECT_NEAR(signal.value(0, 2.0, kLinear, false), 0.0, 1e-12);
  EXPECT_NEAR(signal.value(1, 2.5, kLinear, false), 27.5, 1e-12);
  EXPECT_EQ(signal.value(0, 3.0, kLinear, false), -2.0);
}

TEST(RecordedSignal, HoldsARowUntilTheNext) {
  const RecordedSignal signal = record("t_s,a\n0,1\n1,2\n3,5\n");
  EXPECT_EQ(signal.value(0, 0.999, kHold, false), 1.0);
  EXPECT_EQ(signal.value(0, 1.0 - 1e-12, kHold, false), 2.0) << "rounding must not cost a cycle";
  EXPECT_EQ(signal.value(0, 2.9, kHold, false), 2.0);
}

TEST(RecordedSignal, StaysAtItsLastRowOrBeginsAnewAStepLater) {
  const RecordedSignal signal = record("t_s,a\n0,1\n1,2\n2,4\n");
  EXPECT_EQ(signal.value(0, 9.0, kLinear, false), 4.0);
  EXPECT_EQ(signal.value(0, 2.5, kHold, true), 4.0);
  EXPECT_NEAR(signal.value(0, 2.5, kLinear, true), 2.5, 1e-9);
  EXPECT_EQ(signal.value(0, 3.0, kHold, true), 1.0);
  EXPECT_NEAR(signal.value(0, 7.5, kLinear, true), 3.0, 1e-8);
}

// Each row of an uneven record is found.
TEST(RecordedSignal, FindsItsRowsHoweverTheyLie) {
  std::string text = "t_s,a\n";
  for (int row = 0; row < 200; ++row) text += fmt::format("{},{}\n", row * row * 1e-3, row);
  const RecordedSignal signal = record(text);
  for (int row = 0; row < 199; ++row) {
    EXPECT_EQ(signal.value(0, row * row * 1e-3, kHold, false), row);
    EXPECT_EQ(signal.value(0, (row * row + row) * 1e-3, kHold, false), row);
  }
}

TEST(RecordedSignal, RefusesWhatIsNoTableOfNumbers) {
  EXPECT_THAT(refusal(""), HasSubstr("found nothing"));
  EXPECT_THAT(refusal("time,a\n0,1\n1,2\n"), HasSubstr("expected one of them to be t_s"));
  EXPECT_THAT(refusal("t_s\n0\n1\n"), HasSubstr("t_s alone"));
  EXPECT_THAT(refusal("t_s,a,a\n0,1,1\n"), HasSubstr("found a second \"a\""));
  EXPECT_THAT(refusal("t_s,,a\n0,1,1\n"), HasSubstr("found no name"));
  EXPECT_THAT(refusal("t_s,a\n0,1\n"), HasSubstr("found 1 rows"));
  EXPECT_THAT(refusal("t_s,a\n0,1\n1,\n"),
              AllOf(HasSubstr("wind.csv:3"), HasSubstr("a: found an empty cell")));
  EXPECT_THAT(refusal("t_s,a\n0,1\n1,2,3\n"), HasSubstr("found 3 cells, expected 2"));
  EXPECT_THAT(refusal("t_s,a\n0,1\n\n1,2\n"), HasSubstr("found an empty line"));
  EXPECT_THAT(refusal("t_s,a\n0,nan\n1,2\n"), HasSubstr("found \"nan\""));
  EXPECT_THAT(refusal("t_s,a\n0,1e999\n1,2\n"), HasSubstr("found \"1e999\""));
  EXPECT_THAT(refusal("t_s,a\n0,1x\n1,2\n"), HasSubstr("found \"1x\""));
  EXPECT_THAT(refusal("t_s,a\n0,1\n0,2\n"),
              AllOf(HasSubstr("wind.csv:3"), HasSubstr("expected more than the 0 before it")));
}

TEST(RecordedSignal, RefusesAGapInARecordOfEqualSteps) {
  EXPECT_THAT(refusal(regular(100, 40, 0.01)),
              AllOf(HasSubstr("wind.csv:42"), HasSubstr("a gap from 0.39 to 0.41 s"),
                    HasSubstr("a row every 0.01 s")));
  EXPECT_EQ(refusal(regular(100, 40, 0.004)), "it was taken") << "jitter";
  EXPECT_EQ(refusal("t_s,a\n0,1\n1,2\n10,3\n10.5,4\n"), "it was taken") << "breakpoints";
}

TEST(RecordedSignal, SuggestsTheNearestColumn) {
  const RecordedSignal signal = record("t_s,wind,hum\n0,1,1\n1,2,2\n");
  EXPECT_EQ(signal.index_of("hum"), 1U);
  try {
    static_cast<void>(signal.index_of("wimd"));
    FAIL() << "expected an InputError";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("did you mean \"wind\"?"));
  }
}

TEST(RecordedSignal, DoesNotAllocateWhileItIsRead) {
  const RecordedSignal signal = record(regular(100, 100, 0.0));
  double sum = 0.0;
  {
    const AllocationGuard guard;
    for (int k = 0; k < 1000; ++k) sum += signal.value(0, 0.003 * k, kLinear, true);
    EXPECT_EQ(guard.heap_calls(), 0U);
  }
  EXPECT_GT(sum, 0.0);
}

}  // namespace
}  // namespace faultline

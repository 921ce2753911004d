#include "tools/log/number_ranges.h"

#include <random>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(NumberRanges, TellsWhatIsMissingBetweenAndBeyond) {
  NumberRanges numbers;
  EXPECT_TRUE(numbers.is_empty());
  EXPECT_THAT(numbers.gaps(0, 3), ElementsAre(NumberRange{0, 2}));
  numbers.add(3, 5);
  numbers.add(8);
  EXPECT_THAT(numbers.gaps(0, 10),
              ElementsAre(NumberRange{0, 2}, NumberRange{6, 7}, NumberRange{9, 9}));
  EXPECT_THAT(numbers.gaps(4, 7), ElementsAre(NumberRange{6, 6}));
  EXPECT_THAT(numbers.gaps(3, 6), IsEmpty());
  EXPECT_THAT(numbers.gaps(5, 5), IsEmpty());
  EXPECT_EQ(count_of(numbers.gaps(0, 10)), 6U);
}

TEST(NumberRanges, IsASetWhateverTheOrder) {
  const std::uint64_t seed = test_seed(20261124);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 random(seed);
  for (int round = 0; round < 200; ++round) {
    NumberRanges numbers;
    std::set<std::int64_t> expected;
    for (int i = 0; i < 30; ++i) {
      const auto first = static_cast<std::int64_t>(random() % 60);
      const auto last = first + static_cast<std::int64_t>(random() % 6);
      bool is_new = true;
      for (std::int64_t number = first; number <= last; ++number) {
        is_new = expected.insert(number).second && is_new;
      }
      ASSERT_EQ(numbers.add(first, last), is_new);
      ASSERT_EQ(numbers.count(), expected.size());
      ASSERT_EQ(numbers.smallest(), *expected.begin());
      ASSERT_EQ(numbers.largest(), *expected.rbegin());
      std::set<std::int64_t> missing;
      for (const NumberRange& gap : numbers.gaps(0, 70)) {
        ASSERT_LE(gap.first, gap.last);
        for (std::int64_t number = gap.first; number <= gap.last; ++number) {
          ASSERT_TRUE(missing.insert(number).second);
        }
      }
      ASSERT_EQ(missing.size() + expected.size(), 70U);
      for (const std::int64_t number : missing) ASSERT_EQ(expected.count(number), 0U);
    }
  }
}

}  // namespace
}  // namespace faultline
